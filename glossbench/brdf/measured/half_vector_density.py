"""A tabulated density of half vectors that samples any isotropic BRDF: marginal and conditional tables."""

from collections.abc import Callable
from dataclasses import dataclass
from math import asin, cos, log, pi, sin, sqrt, tan
from typing import NamedTuple

import torch
from jaxtyping import Int
from torch import Tensor

from glossbench.brdf.measured.half_difference import azimuth
from glossbench.channels import Channels, scalar
from glossbench.directions import Vec3, dot, reflect
from glossbench.shapes import Directions, UnitSquare, Values

VIEWS, RINGS, SECTORS = 45, 90, 36  # cells of the view's angle, of the half vector's angle, of its azimuth
INSIDE = 2  # points per axis and cell at which f is evaluated
EVEN = 0.05  # share of the density that is spread evenly, because f may be positive between those points only


class TabulatedPoints(NamedTuple):
    """Half vectors in the frame turned to the azimuth of the view (VIEWS, N), and a quarter of their density."""

    x: Tensor
    y: Tensor
    z: Tensor
    quarter_pdf: Tensor


@dataclass(frozen=True)
class HalfVectorDensity:
    """Density of half vectors, constant over cells of the hemisphere, for each of 45 angles of the view.

    p(h) = mass / solid angle of the cell of h, in the frame turned to the azimuth of the view. Ring i lies between
    1 - cos_h = (i / 90)^4 and ((i + 1) / 90)^4: rings are 0.01 degrees wide at the normal and 2 degrees at the horizon.
    A view uses the table of the nearest angle. f is divided by the density that its sample really had, so a coarse
    table adds variance but no bias.

    Attributes:
        density: [1/sr], flat over (view, ring, sector).
        marginal: cumulated mass of the rings, from 0 to 1, float64, (45, 91).
        conditional: cumulated mass of the sectors of each ring, float64, flat; k to k + 1 for ring k of all.
    """

    density: Tensor
    marginal: Tensor
    conditional: Tensor

    def sample_points(self, u: UnitSquare) -> TabulatedPoints:
        """Half vectors from points (N, 2), for every angle of the view: u1 chooses the ring, u2 the sector.

        The remainders of u1 and u2 place the half vector in its cell, so a stratified point set stays stratified.
        """
        u1, u2 = u[:, 0].double().expand(VIEWS, -1).contiguous(), u[:, 1].double()
        view = torch.arange(VIEWS, device=u.device)[:, None]
        ring = (torch.searchsorted(self.marginal, u1, right=True) - 1).clamp(0, RINGS - 1)
        below = self.marginal.gather(1, ring)
        a = ((u1 - below) / (self.marginal.gather(1, ring + 1) - below)).clamp(0, 1)
        of_all = view * RINGS + ring
        index = torch.searchsorted(self.conditional, of_all + u2, right=True)
        index = torch.minimum(torch.maximum(index, of_all * SECTORS), of_all * SECTORS + SECTORS - 1)
        sector = index - of_all * SECTORS
        lower = torch.where(sector == 0, 0.0, self.conditional[(index - 1).clamp(min=0)] - of_all)
        b = ((u2 - lower) / (self.conditional[index] - of_all - lower).clamp(min=1e-300)).clamp(0, 1)
        low, high = (ring / RINGS) ** 4, ((ring + 1) / RINGS) ** 4
        away = low + a * (high - low)  # 1 - cos_h, without loss of digits
        r, phi = torch.sqrt(away * (2 - away)), (sector + b) * (2 * pi / SECTORS)
        x, y, z = (c.float() for c in (r * torch.cos(phi), r * torch.sin(phi), 1 - away))
        return TabulatedPoints(x, y, z, self.density[index] / 4)

    def half_vectors(self, wo: Directions, points: TabulatedPoints) -> tuple[Directions, Values]:
        """The points of each view (P, N), turned to its azimuth, and a quarter of their density."""
        n = points.x.shape[1]
        at = _find_view(wo) * n + torch.arange(n, device=wo.z.device, dtype=torch.int32)
        x, y = points.x.view(-1)[at], points.y.view(-1)[at]
        e_x, e_y = azimuth(wo)
        h = Vec3(x * e_x - y * e_y, x * e_y + y * e_x, points.z.view(-1)[at])
        return h, points.quarter_pdf.view(-1)[at]

    def pdf(self, wo: Directions, h: Directions) -> Values:
        """p(h) [1/sr] for a view."""
        e_x, e_y = azimuth(wo)
        away = (h.x * h.x + h.y * h.y) / (1 + h.z)
        ring = (torch.sqrt(torch.sqrt(away)) * RINGS).int().clamp(0, RINGS - 1)
        phi = torch.atan2(h.y * e_x - h.x * e_y, h.x * e_x + h.y * e_y)
        sector = torch.remainder((phi * (SECTORS / (2 * pi))).floor().int(), SECTORS)
        return self.density[(_find_view(wo) * RINGS + ring) * SECTORS + sector]

    def width(self) -> float:
        """Beckmann slope m in [0.001, 1] of the same width for a view along the normal: half of the mass has
        tan^2(theta_h) < m^2 log 2.
        """
        ring = int(torch.searchsorted(self.marginal[0], torch.tensor(0.5, dtype=torch.float64)))
        theta = 2 * asin(sqrt(0.5) * (ring / RINGS) ** 2)
        return min(max(tan(min(theta, 1.5)) / sqrt(log(2)), 1e-3), 1.0)


def build_half_vector_density(f: Callable[[Vec3, Vec3], Channels], device: str) -> HalfVectorDensity:
    """The density that follows f cos_i for an isotropic f(wo, wi), the mean of its channels.

    The mass of a cell is the mean of f cos_i 4 c at four points inside, times its solid angle; 4 c is the solid angle
    of wi divided by that of h. 5 % of the mass is spread as cos_h / pi, because f may be positive between those points
    only, or 0 for a whole view.
    """
    inside = (torch.arange(INSIDE, dtype=torch.float64) + 0.5) / INSIDE
    cells = torch.arange(RINGS + 1, dtype=torch.float64)
    edge = (cells / RINGS) ** 4
    away = edge[:-1, None] + inside * (edge[1:] - edge[:-1])[:, None]
    phi = (torch.arange(SECTORS)[:, None] + inside) * (2 * pi / SECTORS)
    v = away.reshape(RINGS, 1, INSIDE, 1)
    r, angle = torch.sqrt(v * (2 - v)), phi.reshape(1, SECTORS, 1, INSIDE)
    h = Vec3(*(c.float().to(device) for c in (r * torch.cos(angle), r * torch.sin(angle), (1 - v) + 0 * angle)))
    solid_angle = ((edge[1:] - edge[:-1]) * (2 * pi / SECTORS))[:, None].expand(RINGS, SECTORS)
    even = solid_angle * (1 - (edge[1:] + edge[:-1])[:, None] / 2) / pi
    mass = torch.empty(VIEWS, RINGS, SECTORS, dtype=torch.float64)
    for view in range(VIEWS):
        theta = (view + 0.5) * pi / (2 * VIEWS)
        wo = Vec3(*(scalar(k, device) for k in (sin(theta), 0.0, cos(theta))))
        c = dot(wo, h)
        wi = reflect(wo, h)
        value = torch.stack(f(wo, wi)).double().mean(0) * wi.z * 4 * c
        value = torch.where((wi.z > 0) & (c > 0), value, 0.0).mean((2, 3)).cpu() * solid_angle
        total = value.sum()
        mass[view] = (1 - EVEN) * value / total + EVEN * even if total > 0 else even
    mass = mass / mass.sum((1, 2), keepdim=True)
    of_ring = mass.sum(2)
    marginal = torch.cat([of_ring.new_zeros(VIEWS, 1), of_ring.cumsum(1)], 1)
    along = mass.cumsum(2)
    conditional = (along / along[:, :, -1:]).reshape(VIEWS * RINGS, SECTORS)
    conditional = conditional + torch.arange(VIEWS * RINGS, dtype=torch.float64)[:, None]
    tables = ((mass / solid_angle).float().reshape(-1), marginal / marginal[:, -1:], conditional.reshape(-1))
    return HalfVectorDensity(*(t.to(device) for t in tables))


def _find_view(wo: Directions) -> Int[Tensor, "*#pairs"]:
    """The index of the tabulated angle that is nearest to a view."""
    return (torch.acos(wo.z.clamp(0, 1)) * (2 * VIEWS / pi)).int().clamp(0, VIEWS - 1)
