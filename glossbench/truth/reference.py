"""The truth of a light, a material and a view: a sum where nothing hides the light, otherwise by sampling.

Both integrate Lo(wo) = integral of L(wi) f(wo, wi) cos_i dwi, L the bilinear interpolant of the light's texels, and
state an error for each pixel and channel (summation.py, sampling.py). Groups of deviations are stored, so that a number
computed from the reference can be computed again without each group (jackknife.py).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

import torch
from torch import Tensor

from glossbench.brdf.material import MAX_LOBES, Material
from glossbench.envmap.cubemap import CubeMap
from glossbench.errors import InputError, MethodError, check_call, find_nearest
from glossbench.process.surroundings import settled
from glossbench.scene.points import View, image_of
from glossbench.shading.visibility import occluder_of
from glossbench.truth.blocks import build_light_blocks
from glossbench.truth.checkpoint import Checkpoint
from glossbench.truth.pilot import choose_pilot
from glossbench.truth.sampling import FIRST_SAMPLES, N_REPLICATES, build_tables, predict_samples, sample_points
from glossbench.truth.summation import Sums, plan_sum, sum_points

N_GROUPS = 8  # of two replicates each; a metric is evaluated once more for each group
ReferenceMethod = Literal["auto", "summation", "sampling"]


@dataclass(frozen=True)
class Reference:
    """The truth of a light, a material and a view.

    Attributes:
        radiance: (H, W, 3), float64, zero outside the mask.
        standard_error: standard error of each pixel and channel, (H, W, 3), float64.
        mask: (H, W), true where the surface is visible.
        n_samples: samples per pixel, over all replicates and techniques; of a sum, evaluations of f per pixel.
        deviates: (G, H, W, 3), float16: for each group of replicates, its mean minus the radiance, in standard errors;
            0 where the standard error is 0. So errors that are correlated between the pixels of a group are kept. A sum
            has no replicates: half of its groups lie above it and half below (`of_sums`).
        method: summation or sampling.
    """

    radiance: Tensor
    standard_error: Tensor
    mask: Tensor
    n_samples: int
    deviates: Tensor
    method: str = "sampling"

    @staticmethod
    def of(replicates: Tensor, mask: Tensor, n_samples: int) -> "Reference":
        """A reference from replicates (R, P, 3), float64, at the pixels of a mask; R is a multiple of `N_GROUPS`."""
        mean = replicates.mean(0)
        error = replicates.std(0) / len(replicates) ** 0.5
        groups = replicates.unflatten(0, (N_GROUPS, -1)).mean(1)
        deviates = torch.where(error > 0, (groups - mean) / error, 0.0).half()
        kept = torch.stack([image_of(mask, each) for each in deviates])
        return Reference(image_of(mask, mean), image_of(mask, error), mask, n_samples, kept)

    @staticmethod
    def of_sums(sums: Sums, mask: Tensor) -> "Reference":
        """A reference from sums at the pixels of a mask.

        Its stated error takes the place of the standard error. One half of the groups moves every pixel by this error
        in the direction of the sum of lower order, the other half in the opposite direction, so far that the jackknife
        of a metric m gives the standard error |m(T + error) - m(T - error)| / 2 and, if m is linear, no bias.
        """
        step = (N_GROUPS - 1) ** 0.5 * sums.sign
        deviates = torch.stack([image_of(mask, step if i < N_GROUPS // 2 else -step).half() for i in range(N_GROUPS)])
        radiance, error = (image_of(mask, each) for each in (sums.radiance, sums.error))
        n_evaluations = round(sums.evaluations / max(len(step), 1))
        return Reference(radiance, error, mask, n_evaluations, deviates, "summation")

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
    method: ReferenceMethod = "auto",
) -> Reference:
    """The converged image of a material under a light.

    Args:
        relative_error: target for the ratio of noise to mean radiance; a black image is finished after one round.
        max_samples: largest number of samples per pixel and technique, over all replicates; a sum evaluates f as often
            at most. If it is reached first, the noise stays above the target.
        seed: seed of the scrambles.
        progress: called after each doubling with the relative noise and the number of samples per pixel so far; by a
            sum, after each chunk of points.
        checkpoint: a folder for the partial sums, which are saved every ten seconds. If a call is killed, the same call
            continues from them and gives the same bytes. The finished call removes them.
        method: summation, sampling, or auto, which takes the one that is predicted to meet the target with less work.

    Raises:
        InputError: relative_error is not positive, max_samples is below that of the first round, or a view whose points
            hide light from each other cannot be summed.
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
    if method not in get_args(ReferenceMethod):
        names = get_args(ReferenceMethod)
        near = find_nearest(method, names)
        raise InputError(f"reference.method must be one of {', '.join(names)}, got {method!r}{near}")
    if method == "summation" and occluder is not None:
        raise InputError(
            f"reference.method summation needs a view that hides no light from its points, not {view.name}"
        )
    tell = progress or (lambda noise, n_samples: None)
    made_by, key = (type(material), type(occluder)), getattr(occluder, "key", "")
    sources = (*made_by, light.faces, material.key(), points, key, device)
    tables = build_tables(light, reflectance, occluder)
    if occluder is None and method != "sampling":
        blocks, most = build_light_blocks(light), max_samples * tables.n_techniques
        pilot = choose_pilot(points, reflectance, blocks)
        plan = plan_sum(pilot, reflectance, blocks, relative_error, most)
        # Sampling draws its first samples in any case.
        first = FIRST_SAMPLES * N_REPLICATES * tables.n_techniques
        if method == "auto" and (plan.error > relative_error or plan.evaluations > first):
            noise, n_samples = predict_samples(pilot, tables, relative_error, max_samples, seed)
            is_met = noise <= relative_error, plan.error <= relative_error
            method = "sampling" if (is_met[0], -n_samples) > (is_met[1], -plan.evaluations) else "summation"
        if method != "sampling":
            kept = Checkpoint.of(checkpoint, *sources, f"{relative_error!r} {most}")
            return Reference.of_sums(
                sum_points(points, reflectance, blocks, plan, relative_error, tell, kept), view.mask()
            )
    kept = Checkpoint.of(checkpoint, *sources, seed)
    replicates, n_samples = sample_points(points, tables, relative_error, max_samples, seed, tell, kept)
    return Reference.of(replicates, view.mask(), n_samples)
