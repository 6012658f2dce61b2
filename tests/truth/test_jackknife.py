"""The jackknife and the references without a group of replicates, against closed forms."""

import numpy as np
import pytest
import torch

from glossbench.errors import InputError
from glossbench.run.results import Results
from glossbench.truth.jackknife import jackknife, remove_bias
from glossbench.truth.reference import N_GROUPS, Reference
from glossbench.truth.sampling import N_REPLICATES


def without_each(values, statistic):
    return [statistic(np.delete(values, i)) for i in range(len(values))]


def test_the_variance_of_a_mean_is_that_of_the_values_over_their_number():
    x = np.random.default_rng(1).normal(size=8)

    bias, variance = jackknife(x.mean(), without_each(x, np.mean))

    assert bias == pytest.approx(0, abs=1e-15)
    assert variance == pytest.approx(x.var(ddof=1) / 8)


def test_the_bias_of_the_plain_variance_is_taken_off_exactly():
    x = np.random.default_rng(2).normal(size=8)

    assert remove_bias([x.var(), *without_each(x, np.var)]) == pytest.approx(x.var(ddof=1))


def test_what_is_never_below_zero_stays_so_without_its_bias():
    assert remove_bias([1.0, *[1.2] * 8]) == 0
    assert remove_bias([1.0, *[1.2] * 7, -0.1]) == pytest.approx(8 - 7 * (7 * 1.2 - 0.1) / 8)


def test_a_number_without_groups_is_itself():
    assert remove_bias([0.3]) == 0.3


MASK = torch.tensor([[True, False, True], [False, True, True]])


@pytest.fixture
def replicates():
    """Of four pixels, the last of which has no noise."""
    found = 10 + torch.randn(N_REPLICATES, 4, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(3))
    found[:, 3] = 7.0
    return found


@pytest.mark.parametrize("n_groups", [8, 4, 2])
def test_a_reference_without_a_group_is_the_mean_of_the_other_replicates(replicates, n_groups):
    truth = Reference.of(replicates, MASK, 1)

    found = list(truth.left_out(n_groups))

    size = N_REPLICATES // n_groups
    others = [torch.cat([replicates[: i * size], replicates[(i + 1) * size :]]).mean(0) for i in range(n_groups)]
    assert len(found) == n_groups
    # Kept in half precision: a deviate of at most 8 to 2^-9, and the step is at most a standard error of it.
    limit = 2.0**-9 * truth.standard_error[MASK] + 1e-12
    for one, expected in zip(found, others, strict=True):
        assert ((one.radiance[MASK] - expected).abs() <= limit).all()
        assert (one.radiance[~MASK] == 0).all()


def test_a_group_in_the_place_of_another_would_be_noticed(replicates):
    """Twin of the above."""
    truth = Reference.of(replicates, MASK, 1)
    first, second, *_ = truth.left_out()

    off = (first.radiance - second.radiance)[MASK][:3].abs()

    assert (off > 2.0**-9 * truth.standard_error[MASK][:3]).any()


def test_a_pixel_without_noise_is_the_same_without_each_group(replicates):
    assert all((one.radiance[1, 2] == 7).all() for one in Reference.of(replicates, MASK, 1).left_out())


@pytest.mark.parametrize("n_groups", [0, 1, 3, 16])
def test_so_many_groups_cannot_be_made(replicates, n_groups):
    with pytest.raises(InputError, match=f"^n_groups must be one of 2, 4, 8, got {n_groups}$"):
        list(Reference.of(replicates, MASK, 1).left_out(n_groups))


def test_a_group_takes_at_most_half_the_disk_of_the_standard_error(tmp_path):
    results = Results(tmp_path)
    results.create()
    mask = torch.ones(24, 24, dtype=torch.bool)
    noise = torch.randn(N_REPLICATES, 576, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(4))

    results.add_reference("k", Reference.of(1 + noise, mask, 1), 1.0)

    error, deviates = (tmp_path / "references" / f"k_{name}" for name in ("standard_error.exr", "deviates.npz"))
    assert deviates.stat().st_size / N_GROUPS < error.stat().st_size / 2
