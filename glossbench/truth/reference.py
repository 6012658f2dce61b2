"""The converged truth with its standard error: multiple importance sampling of material and light, without MIP levels.

Lo(wo) = integral of L(wi) f(wo, wi) cos_i dwi, L the bilinear interpolant of the light's texels. Techniques: the
light's luminance, each lobe's sampler, and the cosine for a diffuse part. Each technique draws N points of its own
scrambled Sobol sequence, and all are weighted by the balance heuristic (Veach 1997 eq. 9.8): every sample contributes
f L cos_i V / (N sum of all pdfs). V is 0 where the scene hides the light, otherwise 1: a direction that hits the
surface again contributes nothing, so interreflection is left out. Replicates with independent scrambles give the
standard error of each pixel. All sequences are extended together until the noise of the image is below the target.
Groups of replicates are stored, so that a number computed from the reference can be computed again without each group
(jackknife.py).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from math import pi
from pathlib import Path
from typing import Any, NamedTuple

import torch
from torch import Tensor
from torch.quasirandom import SobolEngine

from glossbench.brdf.material import MAX_LOBES, Material, Reflectance
from glossbench.channels import Channels, add, merge_channels
from glossbench.directions import Vec3, cosine_hemisphere, to_local, to_world
from glossbench.envmap.cubemap import CubeMap
from glossbench.envmap.importance import LightDistribution, luminance_distribution
from glossbench.envmap.pyramid import Pyramid, finest, lookup, weighted_radiance
from glossbench.errors import InputError, MethodError, check_call
from glossbench.process.surroundings import settled
from glossbench.scene.points import Occluder, ShadingPoints, View, image_of
from glossbench.shading.kernels import kernel, over_points
from glossbench.shading.visibility import occluder_of, unhidden
from glossbench.truth.checkpoint import Checkpoint

N_REPLICATES = 16  # the relative error of the standard error is 1 / sqrt(2 (16 - 1)) = 18 %
N_GROUPS = 8  # of two replicates each; a metric is evaluated once more for each group
FIRST_SAMPLES = 64  # per replicate and technique


@dataclass(frozen=True)
class Reference:
    """The truth of a light, a material and a view.

    Attributes:
        radiance: (H, W, 3), float64, zero outside the mask.
        standard_error: standard error of each pixel and channel, (H, W, 3), float64.
        mask: (H, W), true where the surface is visible.
        n_samples: samples per pixel, over all replicates and techniques.
        deviates: (G, H, W, 3), float16: for each group of replicates, its mean minus the radiance, in standard errors;
            0 where the standard error is 0. So errors that are correlated between the pixels of a group are kept.
    """

    radiance: Tensor
    standard_error: Tensor
    mask: Tensor
    n_samples: int
    deviates: Tensor

    @staticmethod
    def of(replicates: Tensor, mask: Tensor, n_samples: int) -> "Reference":
        """A reference from replicates (R, P, 3), float64, at the pixels of a mask; R is a multiple of `N_GROUPS`."""
        mean = replicates.mean(0)
        error = replicates.std(0) / len(replicates) ** 0.5
        groups = replicates.unflatten(0, (N_GROUPS, -1)).mean(1)
        deviates = torch.where(error > 0, (groups - mean) / error, 0.0).half()
        kept = torch.stack([image_of(mask, each) for each in deviates])
        return Reference(image_of(mask, mean), image_of(mask, error), mask, n_samples, kept)

    def left_out(self, n_groups: int = N_GROUPS) -> Iterator["Reference"]:
        """For each group, the reference from all replicates except those of this group.

        T_i = T - (g_i - T) / (G - 1), where g_i is the mean of group i, and T the mean of all G groups.

        Args:
            n_groups: G. If it is below the number of stored groups, neighbouring groups are merged.

        Raises:
            InputError: n_groups is below 2, or does not divide the number of stored groups.
        """
        kept = len(self.deviates)
        if n_groups < 2 or kept % n_groups:
            allowed = ", ".join(str(n) for n in range(2, kept + 1) if kept % n == 0)
            raise InputError(f"n_groups must be one of {allowed}, got {n_groups!r}")
        for deviates in self.deviates.unflatten(0, (n_groups, -1)):
            step = deviates.double().mean(0) * self.standard_error / (n_groups - 1)
            yield replace(self, radiance=self.radiance - step)

    @property
    def noise(self) -> float:
        """Root mean square of the standard error over pixels and channels: the RMS error of a perfect image."""
        return float(self.standard_error[self.mask].square().mean().sqrt())

    @property
    def mean(self) -> float:
        """Mean radiance of the surface."""
        return float(self.radiance[self.mask].mean())


class LightSamples(NamedTuple):
    """Directions (1, N), their radiance (N, 3) and pdf (1, N)."""

    direction: Vec3
    radiance: Tensor
    pdf: Tensor


class Tables(NamedTuple):
    """Data that all techniques share; the occluder is None if the scene does not hide light."""

    reflectance: Reflectance
    distribution: LightDistribution
    texels: Pyramid
    occluder: Occluder | None


@settled()
def compute_reference(
    light: CubeMap,
    material: Material,
    view: View,
    relative_error: float = 1e-3,
    max_samples: int = 1 << 16,
    seed: int = 0,
    progress: Callable[[float, int], None] | None = None,
    checkpoint: Path | None = None,
) -> Reference:
    """The converged image of a material under a light.

    Args:
        relative_error: target for the ratio of noise to mean radiance; a black image is finished after one round.
        max_samples: largest number of samples per pixel and technique, over all replicates. If it is reached first, the
            noise stays above the target.
        seed: seed of the scrambles.
        progress: called after each doubling with the relative noise and the number of samples per pixel so far.
        checkpoint: a folder for the partial sums, which are saved every ten seconds. If a call is killed, the same call
            continues from them and gives the same bytes. The finished call removes them.

    Raises:
        InputError: relative_error is not positive, or max_samples is below that of the first round.
        MethodError: the material has more than 16 lobes, the number of kernels.
    """
    check_call("reference", light=(light, CubeMap), material=(material, Material), view=(view, View))
    if not relative_error > 0:
        raise InputError(f"reference.relative_error must be above 0, got {relative_error!r}")
    if max_samples < N_REPLICATES * FIRST_SAMPLES:
        raise InputError(f"reference.max_samples must be at least {N_REPLICATES * FIRST_SAMPLES}, got {max_samples!r}")
    device = str(light.faces.device)
    points = view.points().to(device)
    occluder = occluder_of(view.scene())
    reflectance = material.reflectance(device)
    if len(reflectance.lobes) > MAX_LOBES:
        n_lobes = len(reflectance.lobes)
        raise MethodError(f"{material.name}.reflectance must have at most {MAX_LOBES} lobes, got {n_lobes}")
    tables = Tables(reflectance, luminance_distribution(light), finest(light), occluder)
    n_techniques = 1 + len(reflectance.lobes) + bool(reflectance.diffuse)
    sums = torch.zeros(N_REPLICATES, len(points), 3, dtype=torch.float64, device=device)
    done = [0] * N_REPLICATES
    made_by = type(material), type(occluder)
    key = getattr(occluder, "key", "")
    kept = Checkpoint.of(checkpoint, *made_by, light.faces, material.key(), points, key, seed, device)
    kept.load(sums, done)
    engines = [
        [SobolEngine(2, scramble=True, seed=(seed * N_REPLICATES + r) * 64 + k) for k in range(n_techniques)]
        for r in range(N_REPLICATES)
    ]
    for n, sequences in zip(done, engines, strict=True):
        for engine in sequences:
            engine.fast_forward(n)
    n = max(FIRST_SAMPLES, *done)
    while True:
        for r, sequences in enumerate(engines):
            if done[r] < n:
                new = n - done[r]
                u = [_open(engine.draw(new)).to(device) for engine in sequences]
                sums[r] += _round(points, tables, u)
                done[r] = n
                kept.save(sums, done)
        mean = sums.mean(0) / n
        error = (sums / n).std(0) / N_REPLICATES**0.5
        noise, level = float(error.square().mean().sqrt()), float(mean.mean())
        n_samples = n * N_REPLICATES * n_techniques
        if progress is not None:
            progress(noise / level if level > 0 else 0.0, n_samples)
        if noise <= relative_error * level or 2 * n * N_REPLICATES > max_samples:
            kept.remove()
            return Reference.of(sums / n, view.mask(), n_samples)
        n *= 2


def estimates(light: CubeMap, material: Material, points: ShadingPoints, n_samples: int, seed: int) -> Tensor:
    """One replicate: radiance (P, 3), float64, with n samples per technique, if nothing hides the light."""
    reflectance = material.reflectance(points.device)
    tables = Tables(reflectance, luminance_distribution(light), finest(light), None)
    n_techniques = 1 + len(reflectance.lobes) + bool(reflectance.diffuse)
    engines = [SobolEngine(2, scramble=True, seed=seed * 64 + k) for k in range(n_techniques)]
    u = [_open(engine.draw(n_samples)).to(points.device) for engine in engines]
    return _round(points, tables, u) / n_samples


def _round(points: ShadingPoints, tables: Tables, u: list[Tensor]) -> Tensor:
    """Sum over one round of samples of every technique, (P, 3), float64."""
    n = u[0].shape[0]
    d, pdf = tables.distribution.sample(u[0])
    lights = LightSamples(Vec3(*(c[None] for c in d)), lookup(tables.texels, d), pdf[None])
    total = over_points(_from_light, points, n, tables, lights).double()
    for k, lobe in enumerate(tables.reflectance.lobes):
        samples = lobe.sample_points(u[1 + k])
        total += over_points(_from_lobe, points, n, tables, samples, k).double()
    if tables.reflectance.diffuse:
        wi = Vec3(*(c[None] for c in cosine_hemisphere(u[-1])))
        total += over_points(_from_cosine, points, n, tables, wi).double()
    return total


@kernel("reference_light")
def _from_light(points: ShadingPoints, tables: Tables, lights: LightSamples) -> Tensor:
    wo, wi = points.wo_local(), to_local(lights.direction, points.t, points.b, points.n)
    weight = _balanced(tables.reflectance, wo, wi, lights.pdf)
    weight = unhidden(weight, points, lights.direction, tables.occluder)
    sums = [w @ lights.radiance for w in weight]
    return merge_channels(sums)


def _from_surface(points: ShadingPoints, tables: Tables, wo: Vec3, wi: Vec3) -> Tensor:
    d = to_world(wi, points.t, points.b, points.n)
    weight = unhidden(_balanced(tables.reflectance, wo, wi, tables.distribution.pdf(d)), points, d, tables.occluder)
    return weighted_radiance(tables.texels, d, None, weight)


@kernel("reference_cosine")
def _from_cosine(points: ShadingPoints, tables: Tables, wi: Vec3) -> Tensor:
    return _from_surface(points, tables, points.wo_local(), wi)


def _balanced(reflectance: Reflectance, wo: Vec3, wi: Vec3, light_pdf: Tensor) -> Channels:
    """f cos_i / sum of the pdfs of all techniques, for each channel."""
    pdf, f = light_pdf, reflectance.diffuse_f()
    if reflectance.diffuse:
        pdf = pdf + wi.z.clamp(min=0) / pi
    for lobe in reflectance.lobes:
        value, density = lobe.f_and_pdf(wo, wi)
        f, pdf = add(f, value), pdf + density
    weight = torch.where(wi.z > 0, wi.z / pdf.clamp(min=1e-30), 0.0)
    return tuple(channel * weight for channel in f)


@kernel("reference_lobe")
def _from_lobe(points: ShadingPoints, tables: Tables, samples: Any, k: int) -> Tensor:
    wo = points.wo_local()
    return _from_surface(points, tables, wo, tables.reflectance.lobes[k].sample(wo, samples).wi)


def _open(u: Tensor) -> Tensor:
    """Points of the open unit square, because the logarithm of u is taken."""
    return u.clamp(2.0**-24, 1 - 2.0**-24)
