"""Real spherical harmonics: projection of a light, and its irradiance from nine coefficients."""

from math import factorial, pi, sqrt

import torch
from torch import Tensor

from glossbench.directions import Vec3
from glossbench.envmap.cubemap import CubeMap, texel_directions, texel_solid_angles


def sh_basis(d: Vec3, order: int) -> list[Tensor]:
    """Real orthonormal Y_lm(d) for l < order, in the order l^2 + l + m; order^2 tensors of the shape of d.x.

    Y_lm = K_lm P_l|m|(z) (sqrt(2) Re or Im (x + i y)^|m|), with the Legendre recurrence in z without the factor sin^m:
    P_mm = (2m - 1)!!, P_(m+1)m = (2m + 1) z P_mm, (l - m) P_lm = (2l - 1) z P_(l-1)m - (l + m - 1) P_(l-2)m.
    No Condon-Shortley phase: Y_11 is positive at +x.
    """
    basis: dict[tuple[int, int], Tensor] = {}
    cos_m, sin_m = torch.ones_like(d.x), torch.zeros_like(d.x)  # Re and Im of (x + i y)^m
    p_mm = torch.ones_like(d.x)
    for m in range(order):
        previous, current = torch.zeros_like(p_mm), p_mm
        for l in range(m, order):  # noqa: E741
            k = sqrt((2 * l + 1) / (4 * pi) * factorial(l - m) / factorial(l + m))
            if m == 0:
                basis[l, 0] = k * current
            else:
                basis[l, m] = sqrt(2) * k * current * cos_m
                basis[l, -m] = sqrt(2) * k * current * sin_m
            previous, current = current, ((2 * l + 1) * d.z * current - (l + m) * previous) / (l + 1 - m)
        cos_m, sin_m = d.x * cos_m - d.y * sin_m, d.x * sin_m + d.y * cos_m
        p_mm = p_mm * (2 * m + 1)
    return [basis[band, m] for band in range(order) for m in range(-band, band + 1)]


def project(light: CubeMap, order: int) -> Tensor:
    """Coefficients L_lm = sum over texels of L Y_lm times the texel's exact solid angle: (order^2, 3), float64.

    In a cube finer than 128, blocks of texels are summed first and use the Y_lm of their centre. For order 3 this
    changes a coefficient by less than 1e-4 of the light's power.
    """
    device = light.faces.device
    n = min(light.resolution, 128)
    block = light.resolution // n
    solid_angle = texel_solid_angles(light.resolution).float().to(device)
    power = (light.faces * solid_angle[:, :, None]).view(6, n, block, n, block, 3).sum(dim=(2, 4)).double()
    basis = torch.stack(sh_basis(Vec3(*(c.to(device).double() for c in texel_directions(n))), order))
    return basis.reshape(order * order, -1) @ power.reshape(-1, 3)


def irradiance_coefficients(light: CubeMap) -> Tensor:
    """Coefficients of E(n) = integral of L max(n . wi, 0) dwi by bands 0 to 2: (9, 3), float32.

    E_lm = A_l L_lm with A = pi, 2 pi / 3, pi / 4. Bands above 2 are left out: at most a few percent for natural light;
    E may be negative opposite a single strong light.

    Source: Ramamoorthi and Hanrahan 2001 eq. 8.
    """
    band = torch.tensor([pi] + [2 * pi / 3] * 3 + [pi / 4] * 5, dtype=torch.float64, device=light.faces.device)
    return (band[:, None] * project(light, 3)).float()


def irradiance(coefficients: Tensor, n: Vec3) -> Tensor:
    """E(n) = sum of E_lm Y_lm(n) for normals (P,): (P, 3)."""
    return torch.stack(sh_basis(n, 3), dim=1) @ coefficients
