"""The truth by sampling: multiple importance sampling of material and light, without MIP levels.

Lo(wo) = integral of L(wi) f(wo, wi) cos_i dwi, L the bilinear interpolant of the light's texels. Techniques: the
light's luminance, each lobe's sampler, and the cosine for a diffuse part. Each technique draws N points of its own
scrambled Sobol sequence, and all are weighted by the balance heuristic (Veach 1997 eq. 9.8): every sample contributes
f L cos_i V / (N sum of all pdfs). V is 0 where the scene hides the light, otherwise 1: a direction that hits the
surface again contributes nothing, so interreflection is left out. Replicates with independent scrambles give the
standard error of each pixel. Sequences are extended until the noise of the image is below the target; each half of the
replicates ends by the noise of the other half, so that a mean does not depend on when its samples end. A quarter of the
light's samples is spread evenly over the lit parts of the light, so that a lamp is found beside a sun.
"""

from collections.abc import Callable
from math import pi
from typing import Any, NamedTuple

import torch
from torch import Tensor
from torch.quasirandom import SobolEngine

from glossbench.brdf.material import Material, Reflectance
from glossbench.channels import Channels, add, merge_channels
from glossbench.directions import Vec3, cosine_hemisphere, to_local, to_world
from glossbench.envmap.cubemap import CubeMap
from glossbench.envmap.importance import LightDistribution, luminance_distribution
from glossbench.envmap.pyramid import Pyramid, finest, lookup, weighted_radiance
from glossbench.scene.points import Occluder, ShadingPoints
from glossbench.shading.kernels import kernel, over_points
from glossbench.shading.visibility import unhidden
from glossbench.truth.checkpoint import Checkpoint
from glossbench.truth.pilot import Pilot

N_REPLICATES = 16  # the relative error of the standard error is 1 / sqrt(2 (16 - 1)) = 18 %
FIRST_SAMPLES = 64  # per replicate and technique
EVEN = 0.25  # share of the light's samples that all lit parts of the light get alike
RATE = 0.85  # noise falls about as samples^-0.85


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

    @property
    def n_techniques(self) -> int:
        """The light, each lobe, and the cosine for a diffuse part."""
        return 1 + len(self.reflectance.lobes) + bool(self.reflectance.diffuse)


def build_tables(light: CubeMap, reflectance: Reflectance, occluder: Occluder | None) -> Tables:
    """The data of a light, a material and a scene."""
    return Tables(reflectance, luminance_distribution(light, EVEN), finest(light), occluder)


def sample_points(
    points: ShadingPoints,
    tables: Tables,
    relative_error: float,
    max_samples: int,
    seed: int,
    progress: Callable[[float, int], None],
    kept: Checkpoint,
) -> tuple[Tensor, int]:
    """Replicates (R, P, 3), float64, and the number of samples per pixel, over all replicates and techniques.

    Args:
        kept: file of the partial sums.

    The other arguments are those of `compute_reference`.
    """
    n_techniques, half = tables.n_techniques, N_REPLICATES // 2
    # After the replicates, the means of the half that ended first; after their counts, its number and its count.
    sums = torch.zeros(N_REPLICATES + half, len(points), 3, dtype=torch.float64, device=points.device)
    done = [0] * (N_REPLICATES + 2)
    kept.load(sums, done)
    engines = [
        [SobolEngine(2, scramble=True, seed=(seed * N_REPLICATES + r) * 64 + k) for k in range(n_techniques)]
        for r in range(N_REPLICATES)
    ]
    for n, sequences in zip(done[:N_REPLICATES], engines, strict=True):
        for engine in sequences:
            engine.fast_forward(n)
    n = max(FIRST_SAMPLES, *done[:N_REPLICATES])
    while True:
        for r, sequences in enumerate(engines):
            if done[r] < n:
                new = n - done[r]
                u = [_open(engine.draw(new)).to(points.device) for engine in sequences]
                sums[r] += _round(points, tables, u)
                done[r] = n
                kept.save(sums, done)
        means = sums[:N_REPLICATES] / n
        # Each half ends by the noise of the other: its own noise is low where it missed what is rare and bright.
        ends = [_measure_noise(means[half:]) <= relative_error, _measure_noise(means[:half]) <= relative_error]
        is_last = 2 * n * N_REPLICATES > max_samples
        ended, at = done[N_REPLICATES:]
        if at:
            means[ended * half : (ended + 1) * half] = sums[N_REPLICATES:]
        n_samples = (n + (at or n)) // 2 * N_REPLICATES * n_techniques
        progress(_measure_noise(means), n_samples)
        if is_last or all(ends) or (at and ends[1 - ended]):
            kept.remove()
            return means, n_samples
        if any(ends) and not at:
            ended = ends.index(True)
            sums[N_REPLICATES:] = means[ended * half : (ended + 1) * half]
            done[N_REPLICATES:] = ended, n
        n *= 2


def _measure_noise(means: Tensor, mean: Callable[[Tensor], Tensor] = torch.mean) -> float:
    """The standard error of a mean of all replicates, RMS, judged by some of them, divided by their mean."""
    level = float(mean(means))
    noise = float(mean(means.var(0)).sqrt()) / N_REPLICATES**0.5
    return noise / level if level > 0 else 0.0


def predict_samples(
    pilot: Pilot, tables: Tables, relative_error: float, max_samples: int, seed: int
) -> tuple[float, float]:
    """Relative noise and samples per pixel at which `sample_points` will end, from a first round at a few points."""
    first, kept, tell = N_REPLICATES * FIRST_SAMPLES, Checkpoint(None), lambda noise, n: None
    replicates, n_samples = sample_points(pilot.points, tables, relative_error, first, seed, tell, kept)
    noise, per_sample = _measure_noise(replicates, pilot.mean), n_samples / first
    while noise > relative_error and 2 * first <= max_samples:
        first, noise = 2 * first, noise / 2**RATE
    return noise, first * per_sample


def estimates(light: CubeMap, material: Material, points: ShadingPoints, n_samples: int, seed: int) -> Tensor:
    """One replicate: radiance (P, 3), float64, with n samples per technique, if nothing hides the light."""
    reflectance = material.reflectance(points.device)
    tables = Tables(reflectance, luminance_distribution(light), finest(light), None)
    n_techniques = tables.n_techniques
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
