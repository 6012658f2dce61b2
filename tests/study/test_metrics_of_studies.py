"""Metrics in a study: names, options, and the columns that distinguish them."""

from pathlib import Path

import pytest

from glossbench.errors import InputError
from glossbench.findings.columns import collect_columns, list_metric_columns
from glossbench.run.runner import run_study
from glossbench.study.study import Study, load_study

TWO = "[rms, {mrse: {epsilon: 0.01}}, {mrse: {epsilon: 1}}]"
COLUMNS_OF_TWO = ["rms", "mrse (epsilon 0.01)", "mrse (epsilon 1.0)"]


@pytest.fixture
def study_of(tmp_path: Path):
    def load(metrics: str, more: str = "", methods: str = "{environment_sampling: {samples: 2}}") -> Study:
        (tmp_path / "s.yaml").write_text(
            "title: T\nlight: {constant: {resolution: 4}}\nmaterial: ggx\nview: {sphere: {resolution: 8}}\n"
            f"methods: {methods}\nmetrics: {metrics}\nreference: {{relative_error: 0.1}}\n{more}"
        )
        return load_study(tmp_path / "s.yaml")

    return load


def test_a_metric_takes_its_options(study_of):
    [flip] = study_of("{flip: {pixels_per_degree: 40}}").metrics
    assert (flip.name, flip.pixels_per_degree) == ("flip", 40)


def test_a_metric_alone_of_its_name_has_the_column_of_its_name(study_of):
    assert study_of("[rms, {mrse: {epsilon: 1}}]").metric_columns == ["rms", "mrse"]


def test_two_of_one_metric_have_columns_that_their_options_distinguish(study_of):
    assert study_of(TWO).metric_columns == COLUMNS_OF_TWO


def test_a_list_of_values_is_one_metric_each(study_of):
    assert study_of("[rms, {mrse: {epsilon: [0.01, 1]}}]").metrics == study_of(TWO).metrics


@pytest.mark.parametrize("metrics", ["rms", TWO, "{flip: {pixels_per_degree: 40}}", "[mrse_trimmed]"])
def test_a_resolved_study_has_the_same_metrics(study_of, metrics):
    study = study_of(metrics)
    again = study_of(str(study.resolved()["metrics"]))
    assert (again.metrics, again.metric_columns) == (study.metrics, study.metric_columns)


def test_the_metrics_of_a_resolved_study_have_the_columns_of_the_study(study_of):
    study = study_of(TWO)
    columns = list_metric_columns(study.resolved()["metrics"])
    assert [column.name for column in columns] == study.metric_columns
    assert [column.unit for column in columns] == ["radiance", "", ""]


def test_the_title_of_a_metric_states_options_that_its_column_does_not():
    assert collect_columns(["rms", {"mrse": {"epsilon": 1.0}}])["mrse"].title == "mrse (epsilon 1)"


@pytest.mark.parametrize(
    ("metrics", "message"),
    [
        ("[rms, {flip: {pixels: 40}}]", "s.yaml:6:24: metrics[1].flip: unknown option 'pixels'"),
        ("[{mrse: {epsilon: -1}}]", "s.yaml:6:28: metrics[0].mrse.epsilon must be greater than 0, got -1"),
        ("[{mrse: {epsilon: {tune: rms}}}]", "metrics[0].mrse.epsilon: only an option of a method can be tuned"),
        ("[3]", "s.yaml:6:11: metrics[0] must be a name, or one name with its options below it, got 3"),
    ],
)
def test_a_wrong_metric_is_one_line_with_its_place(study_of, metrics, message):
    with pytest.raises(InputError) as raised:
        study_of(metrics)
    assert message in str(raised.value)


CLAIM = "claims: [{{text: A, value: environment_sampling, of: {of}, between: [0, null]}}]"


def test_a_claim_names_one_of_two_metrics_by_its_column(study_of):
    [claim] = study_of(TWO, CLAIM.format(of="mrse (epsilon 1.0)")).claims
    assert claim.of == "mrse (epsilon 1.0)"


def test_a_claim_by_a_name_that_two_metrics_have_is_refused(study_of):
    with pytest.raises(InputError, match=r"'mrse' may mean 'mrse \(epsilon 0\.01\)' or 'mrse \(epsilon 1\.0\)'"):
        study_of(TWO, CLAIM.format(of="mrse"))


TUNED = "{{filtered_importance_sampling: {{samples: 2, mip_bias: {{tune: {by}, range: [0, 1]}}}}}}"


def test_tuning_by_a_name_that_two_metrics_have_is_refused(study_of):
    with pytest.raises(InputError, match=r"tune: 'mrse' may mean .*: say which"):
        study_of(TWO, methods=TUNED.format(by="mrse"))


def test_tuning_may_be_by_one_of_two_metrics(study_of):
    [candidate] = study_of(TWO, methods=TUNED.format(by="mrse (epsilon 1.0)")).methods
    assert candidate.tune.metric == "mrse (epsilon 1.0)"


def test_each_of_two_metrics_is_measured_with_its_own_options(study_of, tmp_path):
    results = run_study(study_of(TWO), tmp_path / "r")
    [row] = results.cells.to_dict("records")
    small, large = (row[column] for column in COLUMNS_OF_TWO[1:])
    assert results.metrics == COLUMNS_OF_TWO
    assert small > 2 * large > 0  # the denominator y^2 + epsilon; y is about 0.3


def test_another_option_of_a_metric_makes_a_cell_new(study_of, tmp_path):
    keys = [
        run_study(study_of(f"[rms, {{mrse: {{epsilon: {x}}}}}]"), tmp_path / f"{x}").cells["key"][0] for x in (1, 2)
    ]
    assert keys[0] != keys[1]
