"""What a run measures of a cell: metrics free of the reference's bias, and what they are without each group."""

import json

import numpy as np
import pytest

from glossbench.metrics import METRICS, Metric
from glossbench.run.results import Results
from glossbench.run.runner import run_study
from glossbench.study.study import load_study
from glossbench.truth.jackknife import remove_bias

STUDY = """
title: T
source: S
question: Q?
light: {spots: {seed: 7, resolution: 16}}
material: {ggx: {alpha: 0.3}}
view: {sphere: {resolution: 8}}
methods: [{importance_sampling: {points: [random, hammersley], samples: 64}}]
reference: {relative_error: 1.0, max_samples: 1024}
metrics: [mean_error, flip, of_a_plug_in, endless]
"""


class OfAPlugIn(Metric):
    """The mean squared error, which does not state its noise."""

    formula = map_formula = "mean((x - y)^2)"
    unit = "1"

    def errors(self, x, y, mask):
        return np.mean((x - y) ** 2, axis=2)


class Endless(OfAPlugIn):
    """Infinite."""

    def pooled(self, errors):
        return float("inf")


@pytest.fixture(scope="module")
def results(tmp_path_factory) -> Results:
    folder = tmp_path_factory.mktemp("measuring")
    (folder / "study.yaml").write_text(STUDY)
    METRICS.register("of_a_plug_in")(OfAPlugIn)
    METRICS.register("endless")(Endless)
    return run_study(load_study(folder / "study.yaml"), folder / "r")


@pytest.fixture
def row(results):
    row = results.cells.to_dict("records")[0]
    assert row["status"] == "done", row["reason"]
    return row


@pytest.mark.parametrize(("metric", "n"), [("rms", 8), ("mean_error", 8), ("flip", 4), ("of_a_plug_in", 8)])
def test_a_metric_is_measured_without_each_group_and_loses_its_bias(row, metric, n):
    values = json.loads(row["left_out"])[metric]

    assert len(values) == 1 + n
    assert row[metric] == remove_bias(values)


def test_an_infinite_metric_has_no_noise(row):
    assert row["endless"] == np.inf
    assert "endless" not in json.loads(row["left_out"])


def test_a_mean_squared_error_loses_the_references_variance(results, row):
    """Its bias is the square of the noise, of which 8 groups of 2 replicates measure the part between groups."""
    [raw, *left_out] = json.loads(row["left_out"])["of_a_plug_in"]
    key, mask = row["reference_key"], results.mask(row["reference_key"])
    error = results.standard_error(key).astype(float)[mask]
    deviates = results.deviates(key).astype(float)[:, mask]

    between = ((deviates * error) ** 2).sum(0) / (8 * 7)

    assert raw - row["of_a_plug_in"] == pytest.approx(between.mean(), rel=1e-3)  # deviates are kept to 3 digits
    assert between.mean() == pytest.approx((error**2).mean(), rel=0.2)
    assert len(left_out) == 8


def test_the_row_says_whether_points_are_random(results):
    assert list(results.cells["is_random"]) == [True, False]
