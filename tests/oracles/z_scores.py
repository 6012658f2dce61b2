"""The reference against an exact value: its distance in standard errors, judged by Student's t."""

import numpy as np
from scipy.stats import t as student

from glossbench.truth.reference import compute_reference
from glossbench.truth.sampling import N_REPLICATES
from oracles.texel_sums import VIEW


def reference(light, material, relative_error=4e-3, seed=0):
    """Radiance and standard error (P, 3), by sampling."""
    truth = compute_reference(light, material, VIEW, relative_error, seed=seed, method="sampling")
    return truth.radiance[truth.mask].numpy(), truth.standard_error[truth.mask].numpy()


def z_limit(n_values):
    """|z| that n values together pass with 99 %, Sidak: each is a Student's t with 15 degrees of freedom."""
    return student.isf((1 - 0.99 ** (1 / n_values)) / 2, N_REPLICATES - 1)


def check_z(radiance, standard_error, truth, n_tests=4):
    z = (radiance - truth) / standard_error
    assert np.abs(z).max() < z_limit(z.size * n_tests)
