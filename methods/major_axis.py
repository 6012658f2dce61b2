"""Lookups along the major axis of an anisotropic lobe, in a light filtered by round lobes."""

from math import pi, sqrt
from typing import Annotated, NamedTuple

import torch
from pydantic import Field
from torch import Tensor

from glossbench.prefilter import (
    METHODS,
    Contract,
    Lobe,
    Material,
    Method,
    Pyramid,
    Radiance,
    ShadingPoints,
    Vec3,
    ViewTable,
    albedos,
    diffuse_radiance,
    dot,
    ggx_levels,
    irradiance,
    kernel,
    lerp,
    level_of_alpha,
    normalize,
    over_points,
    reflect,
    to_world,
    weighted_radiance,
)


class Ellipse(NamedTuple):
    """The half axes of an ellipse of slopes, r_x along t and r_y along b."""

    x: Tensor
    y: Tensor


@METHODS.register("major_axis")
class MajorAxis(Method):
    """Lo ~ A(wo) (1/N) sum over i of P(reflection of wo at m_i, w): N lookups along the axis of the reflected lobe.

    The ellipse of slopes with half axes alpha / sqrt(2), one standard deviation, is reflected. The normals m_i lie on
    the arc between the two whose reflections are farthest from the mirror direction, clipped to the horizon and
    shortened by the width of the lobe across it. P is the light filtered by round lobes of GGX. Their alpha is half the
    width W_min across the arc, or half of 2.3 W_max / N if that is wider; for a round lobe seen along the normal it is
    about 1.4 alpha. A is the directional albedo. All lookups weigh the same, so it cannot show that a lobe falls off
    along its axis: a highlight is a streak with ends. Nor can it show a tail that is not GGX's.

    Attributes:
        samples: N.

    Source: Cocco et al. 2024, and its authors' code (AnisotropyEditor). Differs: the directional albedo by a table, not
    by a fit; each level of the light is a sum over texels; rough levels have 16 texels along an edge or more.
    """

    samples: Annotated[int, Field(ge=2, le=256)] = 8

    equation = "L_o approx A(omega_o) 1/N sum_(i=1)^N P(2 (omega_o dot m_i) m_i - omega_o, w)"
    # It is linear to 1e-4 only: in the chain, coarse texels stand where their light has its centroid.
    contract = Contract(furnace=1e-3, linear=False)

    ggx_levels, irradiance, albedos = ggx_levels, irradiance, albedos

    def n_samples(self, material: Material) -> int:
        """Number of lookups, N for each lobe."""
        return self.samples * len(material.as_lobes().lobes)

    def shade(
        self,
        points: ShadingPoints,
        material: Material,
        ggx_levels: Pyramid,
        albedos: tuple[ViewTable, ...],
        irradiance: Tensor,
    ) -> Radiance:
        """Radiance (P, 3)."""
        reflectance = material.as_lobes(points.device)
        radiance = diffuse_radiance(reflectance, irradiance, points.n)
        places = torch.linspace(0, 1, self.samples, device=points.device)[None]
        for lobe, albedo in zip(reflectance.lobes, albedos, strict=True):
            mean = (
                over_points(_sum_lookups, points, self.samples, find_ellipse(lobe), places, ggx_levels) / self.samples
            )
            radiance = radiance + albedo.at(points.wo_local()) * mean
        return radiance


def find_ellipse(lobe: Lobe) -> Ellipse:
    """Half axes alpha / sqrt(2). A Beckmann lobe of slope m has the peak and the standard deviation of alpha = m."""
    return Ellipse(*(width / sqrt(2) for width in lobe.widths))


@kernel("major_axis")
def _sum_lookups(points: ShadingPoints, ellipse: Ellipse, places: Tensor, levels: Pyramid) -> Radiance:
    """Sum over the lookups at places in [0, 1] along the arc."""
    wo = points.wo_local()
    first, last, width = find_arc(wo, ellipse, places.shape[1])
    m = normalize(lerp(first, last, places))
    d = to_world(reflect(wo, m), points.t, points.b, points.n)
    lod = level_of_alpha(levels, width).expand(d.shape)
    return weighted_radiance(levels, d, lod, (torch.ones_like(d.x),))


def find_arc(wo: Vec3, ellipse: Ellipse, n: int) -> tuple[Vec3, Vec3, Tensor]:
    """The first and the last normal of the arc, and the alpha of the n lookups along it."""
    t_min, t_max = find_extremes(wo, ellipse)
    e = Vec3(ellipse.x * torch.cos(t_max), ellipse.y * torch.sin(t_max), torch.ones_like(t_max))
    m_0, m_1 = normalize(Vec3(-e.x, -e.y, e.z)), normalize(e)
    # Where the reflection reaches the horizon.
    q = m_1.x * wo.x + m_1.y * wo.y
    k = (wo.z * (1 - m_1.z * m_1.z)).clamp(min=1e-12)
    root = torch.sqrt(q * q + wo.z * k)
    start = (0.5 + m_1.z * (q - root) / (2 * k)).clamp(min=0)
    end = (0.5 + m_1.z * (q + root) / (2 * k)).clamp(max=1)
    first, last = normalize(lerp(m_0, m_1, start)), normalize(lerp(m_0, m_1, end))
    # Across the arc, moved along with its middle.
    moved = torch.where(start > 0, start, end - 1) * (t_min - t_max)
    across = [_find_normal(ellipse, t) for t in (t_min + moved, t_min - moved + pi)]
    w_min, w_max = (_measure_chord(reflect(wo, a), reflect(wo, b)) for a, b in (across, (first, last)))
    middle = normalize(Vec3(first.x + last.x, first.y + last.y, first.z + last.z))
    share = ((w_max - w_min) / w_max.clamp(min=1e-12)).clamp(min=0)
    first, last = (normalize(lerp(middle, end, share)) for end in (first, last))
    return first, last, torch.maximum(w_min, 2.3 * w_max / n) / 2


def find_extremes(wo: Vec3, ellipse: Ellipse) -> tuple[Tensor, Tensor]:
    """Parameters t of the slopes (r_x cos t, r_y sin t) whose reflections are nearest to and farthest from the mirror.

    The roots of a quadratic equation of tan t; the slope at t + pi is as far away.
    """
    x2, y2, xx, yy = wo.x * wo.x, wo.y * wo.y, ellipse.x * ellipse.x, ellipse.y * ellipse.y
    p_0 = 2 * wo.x * wo.y * ellipse.x * ellipse.y
    p_1 = x2 * (xx * yy + yy) - y2 * (xx * yy + xx) + xx - yy
    p_2 = -p_0 * (yy + 1)
    p_3 = p_0 * p_2 * (xx + 1)
    s = torch.sqrt((p_1 * p_1 - p_3).clamp(min=0))
    is_aligned = p_2.abs() < 1e-9
    safe = torch.where(is_aligned, torch.ones_like(p_2), p_2)
    aligned = torch.where(p_1 >= 0, pi / 2, 0.0)
    t_min = torch.where(is_aligned, aligned, torch.atan((p_1 + s) / safe))
    t_max = torch.where(is_aligned, aligned + pi / 2, torch.atan((p_1 - s) / safe))
    return t_min, t_max


def _find_normal(ellipse: Ellipse, t: Tensor) -> Vec3:
    """The normal with the slope (r_x cos t, r_y sin t)."""
    return normalize(Vec3(-ellipse.x * torch.cos(t), -ellipse.y * torch.sin(t), torch.ones_like(t)))


def _measure_chord(a: Vec3, b: Vec3) -> Tensor:
    """|a - b|"""
    chord = Vec3(a.x - b.x, a.y - b.y, a.z - b.z)
    return torch.sqrt(dot(chord, chord))
