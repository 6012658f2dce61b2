"""Visibility in spherical harmonics: fitted at each point to shadow tests in a few directions."""

import scipy
import torch
from torch import Tensor

from glossbench.prefilter import Channels, Occluder, ShadingPoints, Vec3, dot, over_points, sh_basis, unhidden

# Eigenvalues below this fraction of the largest are treated as zero. Measured RMS over the mean, on a cloth and on a
# torus knot under Grace, order 4. Diffuse, 16 directions: 1e-6 0.26 and 1.05 (small eigenvalues amplify noise), 1e-4
# 0.045 and 0.107, 1e-3 0.043 and 0.091, 1e-2 0.042 and 0.085. Glossy, 64 directions: up to 1e-3 0.086 and 0.136, 1e-2
# 0.095 and 0.157, 0.1 0.115 and 0.214 (the part that is left out darkens the image).
LEAST_EIGENVALUE = 1e-3


def fit_visibility(points: ShadingPoints, occluder: Occluder, directions: Vec3, order: int) -> Tensor:
    """Coefficients (P, order^2), float32, of the visibility times the cosine, v(w) = V(w) max(n . w, 0).

    c = (B^T B)^+ B^T v, B_jk = Y_k(w_j): least squares over directions (M,), with one shadow ray for each direction
    above the surface. Y_k are in the axes of the world, so that one pseudoinverse serves all points. If there are fewer
    directions than coefficients, or the directions are too close together, the solution with the least norm is used.

    Source: Krivanek and Colbert 2008, section 5.2.
    """
    basis = torch.stack(sh_basis(Vec3(*(c.double() for c in directions)), order), dim=1)
    inverse = torch.linalg.pinv(basis.T @ basis, rtol=LEAST_EIGENVALUE, hermitian=True)
    solver = (basis @ inverse).float()
    rows = Vec3(*(c[None] for c in directions))
    return over_points(_fit, points, len(solver), rows, solver, occluder)


def _fit(points: ShadingPoints, directions: Vec3, solver: Tensor, occluder: Occluder) -> Tensor:
    (v,) = unhidden((dot(points.n, directions).clamp(min=0),), points, directions, occluder)
    return v @ solver


def evaluate_visibility(coefficients: Tensor, d: Vec3, cos_i: Tensor) -> Tensor:
    """V (P, N) in [0, 1] in directions above the surface: the fit of V cos_i, (P, order^2), divided by cos_i."""
    order = round(coefficients.shape[1] ** 0.5)
    fit = sum(coefficients[:, k, None] * y for k, y in enumerate(sh_basis(d, order)))
    return (fit / cos_i.clamp(min=1e-6)).clamp(0, 1)


def attenuate(weight: Channels, points: ShadingPoints, d: Vec3, wi: Vec3, hidden: Occluder | Tensor | None) -> Channels:
    """The weights times the visibility: from one ray per sample, from the coefficients of each point, or 1."""
    if isinstance(hidden, Tensor):
        V = evaluate_visibility(hidden, d, wi.z)
        return tuple(w * V for w in weight)
    return unhidden(weight, points, d, hidden)


def smooth(values: Tensor, mask: Tensor, sigma: float) -> Tensor:
    """Values (P, K) at the pixels of a mask (H, W), each replaced by the Gaussian mean of the values around it.

    Args:
        sigma: standard deviation [pixels]; the Gaussian is cut off at 3 sigma. 0 does not change the values.
    """
    if sigma == 0:
        return values
    weight = scipy.ndimage.gaussian_filter(mask.float().numpy(), sigma, mode="constant", truncate=3)
    image = torch.zeros(*mask.shape, values.shape[1])
    image[mask] = values.cpu()
    blurred = torch.from_numpy(
        scipy.ndimage.gaussian_filter(image.numpy(), (sigma, sigma, 0), mode="constant", truncate=3)
    )
    return (blurred[mask] / torch.from_numpy(weight)[mask][:, None]).to(values.device)
