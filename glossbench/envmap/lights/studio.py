"""A photographer's studio: soft boxes in a dim room, the usual light for pictures of products."""

from math import atan, cos, hypot, sqrt
from typing import Annotated, NamedTuple, Self

import torch
from pydantic import Field
from torch import Tensor

from glossbench.directions import stack
from glossbench.envmap.cubemap import CubeMap, face_directions, texel_directions
from glossbench.envmap.lights.light import LIGHTS, Light
from glossbench.envmap.lights.placing import build_frame
from glossbench.options import Fraction, NonNegative, Radiance, Resolution


class SoftBox(NamedTuple):
    """A bright rectangle that faces the object; its lower edge is horizontal.

    Attributes:
        azimuth: angle of the centre from forward (-z) to the right (+x) [degrees].
        elevation: angle of the centre above the horizon [degrees].
        distance, width, height: lengths [m].
    """

    azimuth: float
    elevation: float
    distance: float
    width: float
    height: float

    def vary(self, u: tuple[float, ...]) -> Self:
        """The box for u in [-1, 1]: azimuth +- 20 degrees, elevation +- 10 degrees, width and height x 0.8 to 1.25."""
        return self._replace(
            azimuth=self.azimuth + 20 * u[0],
            elevation=self.elevation + 10 * u[1],
            width=self.width * 1.25 ** u[2],
            height=self.height * 1.25 ** u[3],
        )


KEY = SoftBox(azimuth=135, elevation=40, distance=2.0, width=1.2, height=1.2)
FILL = SoftBox(azimuth=-130, elevation=10, distance=3.0, width=1.0, height=2.0)
RIM = SoftBox(azimuth=-35, elevation=25, distance=2.0, width=0.3, height=1.5)


@LIGHTS.register("studio")
class Studio(Light):
    """Soft boxes in a room: a key behind the camera on its right, a fill on its left, a rim strip behind the object.

    The room is L(d) = room (1 + d_y / 2), with mean `room`; the boxes add to it. A box of width w and height h at
    distance z subtends 4 atan(w h / (2 z sqrt(4 z^2 + w^2 + h^2))). If softness is 0, its energy is its radiance times
    this solid angle; otherwise its radiance falls towards each edge as 3 x^2 - 2 x^3, x from 1 to 0. A texel that an
    edge cuts is weighted by its bright area.

              azimuth   elevation   distance   width   height
        key     135        40         2 m      1.2 m   1.2 m
        fill   -130        10         3 m      1.0 m   2.0 m
        rim     -35        25         2 m      0.3 m   1.5 m

    Attributes:
        key_light, fill_light, rim_light: radiance of each box, a scalar or RGB.
        room: mean radiance of the room.
        softness: share of the half width and half height over which the radiance of a box falls to zero.
        seed: a number changes the boxes at random: azimuth by up to 20 degrees, elevation by up to 10, width and height
            by factors of 0.8 to 1.25; none keeps the table.
        resolution: texels along the edge of a face, a power of two.

    All numbers are our own choice.
    """

    key_light: Radiance = (40.0, 38.0, 35.0)
    fill_light: Radiance = (8.0, 9.0, 10.0)
    rim_light: Radiance = (60.0, 60.0, 60.0)
    room: NonNegative = 0.1
    softness: Fraction = 0.2
    seed: Annotated[int, Field(ge=0)] | None = None
    resolution: Resolution = 1024

    def cubemap(self) -> CubeMap:
        """The radiance itself."""
        d = stack(texel_directions(self.resolution))
        faces = (self.room * (1 + d[..., 1:2] / 2)).repeat(1, 1, 1, 3)
        for box, radiance in zip(self.place_boxes(), (self.key_light, self.fill_light, self.rim_light), strict=True):
            _add(faces, d, box, torch.tensor(radiance, dtype=torch.float64), self.softness)
        return CubeMap(faces, self.key())

    def place_boxes(self) -> tuple[SoftBox, ...]:
        """Key, fill and rim for this seed."""
        boxes = (KEY, FILL, RIM)
        if self.seed is None:
            return boxes
        u = torch.rand(3, 4, generator=torch.Generator().manual_seed(self.seed), dtype=torch.float64) * 2 - 1
        return tuple(box.vary(tuple(row)) for box, row in zip(boxes, u.tolist(), strict=True))


def _add(faces: Tensor, d: Tensor, box: SoftBox, radiance: Tensor, softness: float) -> None:
    """Adds a box to the faces (6, R, R, 3); d (6, R, R, 3) holds the directions of their texels.

    A plane through the origin and an edge of the box cuts a face in a line. With d scaled to the face, the distance to
    this line is linear in s and t, and the area of a texel on its bright side has a closed form.
    """
    r = faces.shape[1]
    toward, right, up = build_frame(box.azimuth, box.elevation)
    size = (box.width / (2 * box.distance), box.height / (2 * box.distance))
    edges = torch.stack(
        [size[0] * toward + right, size[0] * toward - right, size[1] * toward + up, size[1] * toward - up]
    )
    near = d @ toward.float() > cos(atan(hypot(*size)) + 2 / r)
    p = d[near].double()
    inside = (p / p.abs().amax(1, keepdim=True)) @ edges.T
    zero, one = torch.zeros(()), torch.ones(())
    centre = stack(face_directions(zero, zero)).double()
    across, down = (sqrt(2) * stack(face_directions(*st)).double() - centre for st in ((one, zero), (zero, one)))
    face = near.nonzero()[:, 0]
    lit = _lit_area(inside, (across @ edges.T)[face] / r, (down @ edges.T)[face] / r)
    share = (lit[:, 0] + lit[:, 1] - 1).clamp(min=0) * (lit[:, 2] + lit[:, 3] - 1).clamp(min=0)
    if softness > 0:
        for pair in (inside[:, :2], inside[:, 2:]):
            # The two distances of a pair add up to the width of the box.
            x = (2 * pair.amin(1) / (softness * pair.sum(1))).clamp(0, 1)
            share *= x * x * (3 - 2 * x)
    faces[near] += (share[:, None] * radiance).float()


def _lit_area(g: Tensor, across: Tensor, down: Tensor) -> Tensor:
    """Share of the square |x|, |y| <= 1 where g + across x + down y > 0: a step convolved with two boxes."""
    least = 1e-6 * torch.maximum(across.abs(), down.abs())
    a, b = (torch.maximum(c.abs(), least) for c in (across, down))
    g = g.clamp(-a - b, a + b)
    squares = [
        sign * (g + u * a + v * b).clamp(min=0) ** 2
        for u, v, sign in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))
    ]
    return torch.stack(squares).sum(0) / (8 * a * b)
