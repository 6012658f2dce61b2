"""The kernels that `glossbench bench` measures."""

from types import SimpleNamespace

import pytest

from glossbench.commands import bench, bench_kernels
from glossbench.commands.bench_kernels import method_calls
from glossbench.shading.method import METHODS


def test_each_method_that_sums_over_points_comes_with_the_pairs_of_its_call(monkeypatch):
    quick = [name for name in METHODS.names() if not METHODS.get(name).contract.quick]  # whose stages take no minutes
    monkeypatch.setattr(bench_kernels, "METHODS", SimpleNamespace(names=lambda: quick, get=METHODS.get))

    found = {name: (call.kernel.name, pairs) for name, call, pairs in method_calls(cube=16, view=8, samples=4)}

    assert found["importance_sampling"][0] == "importance_sampling"
    assert found["filtered_importance_sampling affine"][0] == "affine_footprint"
    assert found["partial_environment_maps"][0] == "partial_maps"
    assert found["importance_sampling"][1] == pytest.approx(4 * 52)  # points of a sphere of 8^2
    assert all(pairs > 0 for _, pairs in found.values())


def test_the_maps_that_are_measured_are_those_of_regions():
    """`split_sum` has an option `storage`, too, but no regions."""
    found = [(name, storage) for name, storage, _ in bench.find_map_stages()]

    assert {"cube", "cropped", "parabolic"} == {storage for name, storage in found}
    assert {name for name, _ in found} == {"partial_environment_maps"}
