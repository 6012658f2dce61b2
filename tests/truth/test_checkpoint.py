"""Partial sums are known by all that decides them."""

from glossbench.brdf.ggx import GGX
from glossbench.brdf.kurt import Kurt
from glossbench.truth.checkpoint import Checkpoint


def path_of(folder, *parts):
    return Checkpoint.of(folder, *parts).path


def test_the_source_of_a_class_decides_which_sums_are_taken_up(tmp_path, monkeypatch):
    before = path_of(tmp_path, Kurt, "key", 1)

    assert path_of(tmp_path, Kurt, "key", 1) == before
    assert path_of(tmp_path, GGX, "key", 1) != before
    monkeypatch.setattr("glossbench.truth.checkpoint.compute_source_hash", lambda cls: "of another version")
    assert path_of(tmp_path, Kurt, "key", 1) != before
