"""Samples a light by its luminance: marginal and conditional distributions over texels, and their density."""

from dataclasses import dataclass

import torch
from torch import Tensor

from glossbench.channels import LUMINANCE
from glossbench.directions import Vec3
from glossbench.envmap.cubemap import CubeMap, add_border, face_coordinates, face_directions, texel_solid_angles

PARTS = 8  # of a face along each axis


@dataclass(frozen=True)
class LightDistribution:
    """A density over directions, constant in the face coordinates of each texel.

    Attributes:
        density: probability of a texel divided by its area in face coordinates, P_texel R^2 / 4, (6 R, R), float32.
        marginal: cumulative probability of the 6 R rows of texels, (6 R + 1,), float64.
        conditional: cumulative probability along each row, plus the row's number, so that it increases over all rows,
            (6 R R,), float64.
    """

    density: Tensor
    marginal: Tensor
    conditional: Tensor

    def sample(self, u: Tensor) -> tuple[Vec3, Tensor]:
        """Directions (N,) from points (N, 2) of the unit square, and their pdf (N,) [1/sr].

        u1 chooses the row and u2 the column; their remainders place the direction inside the texel, so a stratified
        point set stays stratified.
        """
        r = self.density.shape[1]
        u1, u2 = u[:, 0].double(), u[:, 1].double()
        row = (torch.searchsorted(self.marginal, u1, right=True) - 1).clamp(0, 6 * r - 1)
        v = (u1 - self.marginal[row]) / (self.marginal[row + 1] - self.marginal[row])
        index = torch.searchsorted(self.conditional, row + u2, right=True)
        index = torch.minimum(torch.maximum(index, row * r), row * r + r - 1)
        upper = self.conditional[index] - row
        lower = torch.where(index % r == 0, 0.0, self.conditional[(index - 1).clamp(min=0)] - row)
        w = ((u2 - lower) / (upper - lower).clamp(min=1e-300)).clamp(0, 1)
        s, t = ((index % r + w) * 2 / r - 1), ((row % r + v.clamp(0, 1)) * 2 / r - 1)
        all_faces = face_directions(s, t)
        face = row // r
        d = Vec3(*(c.to(face.device).gather(0, face[None])[0] for c in all_faces))
        # The density of the chosen texel: in float32 a direction at its edge may fall into a black neighbour.
        major = torch.maximum(torch.maximum(d.x.abs(), d.y.abs()), d.z.abs())
        return d, self.density[row, index % r] / (major * major * major)

    def pdf(self, d: Vec3) -> Tensor:
        """Density [1/sr] at unit directions: density * (area on the face per solid angle) = density / major^3."""
        face, s, t, major = face_coordinates(d)
        r = self.density.shape[1]
        column = ((s + 1) * (0.5 * r)).int().clamp(0, r - 1)
        row = ((t + 1) * (0.5 * r)).int().clamp(0, r - 1)
        return self.density[face * r + row, column] / (major * major * major)


def luminance_distribution(light: CubeMap, even: float = 0.0) -> LightDistribution:
    """The distribution whose probability per texel is proportional to solid angle times mean luminance of the light.

    The mean is over the bilinear interpolant, [1 6 1] / 8 along each axis, so the density is positive wherever the
    light is. A light that is black everywhere is sampled uniformly.

    Args:
        even: share of the probability that all lit parts of the light get alike, 8 x 8 to a face, so that a lamp is
            found beside a sun: within a part it follows the luminance, too.
    """
    r = light.resolution
    weights = torch.tensor(LUMINANCE, dtype=torch.float32, device=light.faces.device)
    luminance = add_border((light.faces @ weights)[..., None])[..., 0].double()
    rows = (luminance[:, :-2] + 6 * luminance[:, 1:-1] + luminance[:, 2:]) / 8
    mean = (rows[:, :, :-2] + 6 * rows[:, :, 1:-1] + rows[:, :, 2:]) / 8
    solid_angle = texel_solid_angles(r).to(mean.device)
    mass = mean * solid_angle
    if not mass.sum() > 0:
        mass = solid_angle.expand(6, r, r)
    probability = mass / mass.sum()
    if even:
        n = min(r, PARTS)
        parts = probability.view(6, n, r // n, n, r // n)
        of_part = parts.sum((2, 4), keepdim=True)
        share = parts / of_part.clamp(min=1e-300) / (of_part > 0).sum()
        probability = (1 - even) * probability + even * share.view(6, r, r)
    probability = probability.reshape(6 * r, r)
    of_row = probability.sum(1)
    marginal = torch.cat([of_row.new_zeros(1), of_row.cumsum(0)])
    marginal = marginal / marginal[-1]
    along = probability.cumsum(1)
    along = along / along[:, -1:].clamp(min=1e-300)
    conditional = along + torch.arange(6 * r, device=mean.device, dtype=torch.float64)[:, None]
    density = (probability * (r * r / 4)).float()
    return LightDistribution(density, marginal, conditional.reshape(-1))
