"""The kernels that `glossbench bench` measures."""

import pytest

from glossbench.commands import bench_kernels
from glossbench.commands.bench_kernels import method_calls


def test_each_method_that_sums_over_points_comes_with_the_pairs_of_its_call(monkeypatch):
    every = bench_kernels._variants
    quick = lambda samples: [each for each in every(samples) if not each[1].contract.quick]  # noqa: E731
    monkeypatch.setattr(bench_kernels, "_variants", quick)  # without those whose stages take long

    found = {name: (call.kernel.name, pairs) for name, call, pairs in method_calls(cube=16, view=8, samples=4)}

    assert found["importance_sampling"][0] == "importance_sampling"
    assert found["filtered_importance_sampling affine"][0] == "affine_footprint"
    assert found["partial_environment_maps"][0] == "partial_maps"
    assert found["importance_sampling"][1] == pytest.approx(4 * 52)  # points of a sphere of 8^2
    assert all(pairs > 0 for _, pairs in found.values())
