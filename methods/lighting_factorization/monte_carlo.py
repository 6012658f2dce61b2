"""The lighting function by Monte Carlo: light and material sampled for each pair of normal and view, with the error."""

import torch

from glossbench.prefilter import CubeMap, LightingSamples, Material, estimates, pair_points, valid_pairs

REPLICATES = 4


def estimate_lighting_function(
    light: CubeMap, material: Material, edge: int = 12, n_samples: int = 64, seed: int = 0
) -> LightingSamples:
    """Lo of all valid pairs of a virtual cube by multiple importance sampling, and its standard error.

    The estimator is the reference's, with N / 4 samples a technique in each of four replicates; the light is not
    averaged to fewer texels first. The standard error of four replicates is itself known to 40 %.
    """
    pairs = valid_pairs(edge)
    points = pair_points(edge, pairs)
    n = -(-n_samples // REPLICATES)
    replicates = torch.stack([estimates(light, material, points, n, seed * REPLICATES + r) for r in range(REPLICATES)])
    mean, error = replicates.mean(0), replicates.std(0) / REPLICATES**0.5
    return LightingSamples(mean, pairs, edge, len(pairs) * n * REPLICATES, error)
