"""Shading points: position, frame and direction to the viewer; and the views that make them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Shaped
from torch import Tensor

from glossbench.catalog.naming import explain_catalog_name
from glossbench.directions import Vec3, to_local
from glossbench.memory import check_memory
from glossbench.options import Options
from glossbench.registry import Registry
from glossbench.shapes import Directions, Mask, Picture, Rays, Seen

# Points take 120 (sphere) to 230 (mesh), measured; images, references and replicates come on top.
BYTES_A_PIXEL = 400


@dataclass(frozen=True)
class ShadingPoints:
    """P surface points seen from outside: a right-handed frame and the direction to the viewer.

    Attributes:
        t: tangent.
        b: bitangent n x t.
        n: shading normal, n . wo > 0.
        wo: direction to the viewer.
        position: position in the scene; None if the scene does not hide light.
        ng: normal of the surface itself, ng . wo > 0, because n may be interpolated; None if position is None.
    """

    t: Directions
    b: Directions
    n: Directions
    wo: Directions
    position: Directions | None = None
    ng: Directions | None = None

    def __len__(self) -> int:
        return self.n.x.shape[0]

    @property
    def device(self) -> str:
        """The device of the tensors."""
        return str(self.n.x.device)

    def columns(self, start: int, stop: int) -> "ShadingPoints":
        """Points [start, stop) with components (P, 1), which broadcast with samples (1, N)."""
        return self.map(lambda c: c[start:stop, None])

    def wo_local(self) -> Directions:
        """The direction to the viewer in the frame (t, b, n)."""
        return to_local(self.wo, self.t, self.b, self.n)

    def to(self, device: str) -> "ShadingPoints":
        """The same points on another device."""
        return self.map(lambda c: c.to(device))

    def map(self, change: Callable[[Tensor], Tensor]) -> "ShadingPoints":
        """The points, with the same change applied to every component."""
        return ShadingPoints(*(v and Vec3(*map(change, v)) for v in vars(self).values()))


class Occluder:
    """A scene in which points can hide light from others. A scene of another class, like the sphere, hides no light."""

    def visible(self, position: Rays, ng: Rays, direction: Rays) -> Seen:
        """Whether light from a direction reaches a position; ng as in ShadingPoints."""
        raise NotImplementedError


class View(Options):
    """A surface and a camera: the content of an image."""

    def mask(self) -> Mask:
        """True where a pixel shows the surface."""
        raise NotImplementedError

    def points(self) -> ShadingPoints:
        """The shading points of the mask's pixels, row by row."""
        raise NotImplementedError

    def scene(self) -> Any:
        """The geometry; it is equal for all views of the same surface."""
        raise NotImplementedError

    def recorded(self, radiance: Picture) -> Picture:
        """The radiance that metrics compare, from that of an image or a reference; by default it is unchanged."""
        return radiance


def check_pixels(view: View, height: int, width: int) -> None:
    """Raises InputError if the points, images and references of so many pixels do not fit into memory."""
    check_memory(f"{view.name}: a view of {width} x {height} pixels", BYTES_A_PIXEL * height * width)


VIEWS: Registry[View] = Registry("view", "glossbench.scene", "glossbench.views", explain_catalog_name)


def image_of(mask: Mask, values: Shaped[Tensor, "points channels"]) -> Shaped[Tensor, "height width channels"]:
    """Values of points at the pixels of a mask, zero elsewhere."""
    image = torch.zeros(*mask.shape, values.shape[-1], dtype=values.dtype)
    image[mask] = values.cpu()
    return image
