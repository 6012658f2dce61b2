"""One lookup about a bent normal: what engines do for anisotropic materials."""

from typing import Literal

import torch
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
    cross,
    diffuse_radiance,
    ggx_levels,
    irradiance,
    lerp,
    level_of_alpha,
    lookup,
    normalize,
    reflect,
    to_world,
)

Formula = Literal["filament", "hdrp", "khronos"]


@METHODS.register("bent_normal")
class BentNormal(Method):
    """Lo ~ A(wo) P(d, alpha): one lookup in a light filtered by round lobes of GGX.

    A is the directional albedo, and d the mirror direction at a bent normal n'. With the widths alpha_w along the wide
    axis w and alpha_n along the narrow axis g, a = normalize((g x wo) x g), eta = (alpha_w - alpha_n) / (alpha_w +
    alpha_n) and r = sqrt(alpha):

        filament: alpha = (alpha_w + alpha_n) / 2; n' = lerp(n, a, eta min(5 r, 1)); d = lerp(mirror, n, alpha^2).
        hdrp: the same alpha; n' = lerp(n, a, eta min(1.5 sqrt(r), 1)); r' = r min(1.2 - eta, 1); with s = 1 - alpha,
            d = lerp(n, mirror, min(s s + s c^2, 1) (sqrt(s) + alpha)), c = n . wo; P at r'.
        khronos: alpha = alpha_n, s = sqrt((alpha_w - alpha_n) / (1 - alpha_n)); n' = lerp(a, n, (1 - s (1 - r))^4);
            d = lerp(mirror, n', r^2).

    The lobe stays round: it cannot show a streak, only a highlight that has moved. The formulas were chosen by eye.

    Attributes:
        formula: whose formula.

    Source: Revie 2011; Filament, Unity HDRP and KHR_materials_anisotropy from their sources. Differs: the directional
    albedo by a table, and each level of the light is a sum over texels.
    """

    formula: Formula = "filament"

    equation = "L_o approx A(omega_o) P(d, alpha)"
    # It is linear to 1e-4 only: in the chain, coarse texels stand where their light has its centroid.
    contract = Contract(furnace=1e-3, linear=False)

    ggx_levels, irradiance, albedos = ggx_levels, irradiance, albedos

    def shade(
        self,
        points: ShadingPoints,
        material: Material,
        ggx_levels: Pyramid,
        albedos: tuple[ViewTable, ...],
        irradiance: Tensor,
    ) -> Radiance:
        """Radiance (P, 3)."""
        reflectance, wo = material.as_lobes(points.device), points.wo_local()
        radiance = diffuse_radiance(reflectance, irradiance, points.n)
        for lobe, albedo in zip(reflectance.lobes, albedos, strict=True):
            d, alpha = bend(lobe, wo, self.formula)
            lod = level_of_alpha(ggx_levels, alpha).expand(len(points))
            filtered = lookup(ggx_levels, to_world(d, points.t, points.b, points.n), lod)
            radiance = radiance + albedo.at(wo) * filtered
        return radiance


def bend(lobe: Lobe, wo: Vec3, formula: Formula) -> tuple[Vec3, Tensor]:
    """The direction of the lookup in the local frame, and its alpha."""
    wide, narrow = (pick(*lobe.widths) for pick in (torch.maximum, torch.minimum))
    is_wide_t = (lobe.widths[0] >= lobe.widths[1]).float()
    zero = torch.zeros_like(wo.x)
    grain = Vec3(zero + 1 - is_wide_t, zero + is_wide_t, zero)
    n, across = Vec3(zero, zero, zero + 1), normalize(cross(cross(grain, wo), grain))
    eta, alpha = (wide - narrow) / (wide + narrow), (wide + narrow) / 2
    if formula == "khronos":
        s = torch.sqrt((wide - narrow) / (1 - narrow).clamp(min=1e-6)).clamp(max=1)
        r = torch.sqrt(narrow)
        bent = normalize(lerp(across, n, (1 - s * (1 - r)) ** 4))
        return normalize(lerp(reflect(wo, bent), bent, narrow)), narrow
    r = torch.sqrt(alpha)
    if formula == "filament":
        bent = normalize(lerp(n, across, eta * (5 * r).clamp(max=1)))
        return normalize(lerp(reflect(wo, bent), n, alpha * alpha)), alpha
    bent = normalize(lerp(n, across, eta * (1.5 * torch.sqrt(r)).clamp(max=1)))
    smooth = 1 - alpha
    share = (torch.sqrt(smooth) + alpha) * (smooth * smooth + smooth * wo.z * wo.z).clamp(max=1)
    r = r * (1.2 - eta).clamp(max=1)
    return normalize(lerp(n, reflect(wo, bent), share)), r * r
