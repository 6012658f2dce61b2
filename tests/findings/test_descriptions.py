"""What a run knew of its methods, materials, lights, views and metrics, and what later readers find of it."""

import json
import re

import pytest

from glossbench.errors import InputError
from glossbench.findings.descriptions import Descriptions, describe, describe_options, describe_study
from glossbench.metrics import METRICS
from glossbench.shading.method import METHODS

STUDY = {
    "source": "figure 3 of Walter et al. 2007", "light": [{"spots": {}}], "material": [{"ggx": {"alpha": [0.1, 0.1]}}],
    "view": [{"sphere": {}}], "methods": [{"filtered_importance_sampling": {"samples": 4}}], "metrics": ["flip"],
}  # fmt: skip


@pytest.fixture(scope="module")
def descriptions() -> Descriptions:
    return describe_study(STUDY)


def test_everything_that_a_study_names_is_described(descriptions):
    assert {(each.kind, each.name) for each in descriptions.described} == {
        ("light", "spots"), ("material", "ggx"), ("view", "sphere"), ("method", "filtered_importance_sampling"),
        ("metric", "flip"),
    }  # fmt: skip


def test_a_method_brings_its_text_equation_and_options(descriptions):
    cls = METHODS.get("filtered_importance_sampling")
    found = descriptions.find("method", "filtered_importance_sampling")
    assert found.equation == cls.equation != ""
    assert found.text.splitlines()[0] == cls.__doc__.splitlines()[0]
    assert found.options == describe_options(cls)
    assert "samples" in found.options


def test_a_metric_brings_its_formula_and_unit():
    found = describe("metric", METRICS.get("rms"))
    assert (found.formula, found.unit) == ("sqrt(mean((x - y)^2))", "radiance")


def test_the_works_of_the_sources_and_of_the_study_are_kept_as_bibtex(descriptions):
    assert {"walter2007", "andersson2021"} <= {key.lower() for key in descriptions.references}
    assert all(re.match(r"@\w+\{", text) for text in descriptions.references.values())


def test_what_is_not_installed_is_not_described():
    found = describe_study(STUDY | {"methods": [{"of_a_plugin": {}}]})
    assert found.find("method", "of_a_plugin") is None


def test_descriptions_come_back_from_json_as_they_were(descriptions):
    assert Descriptions.from_dict(json.loads(json.dumps(descriptions.as_dict()))) == descriptions


@pytest.mark.parametrize("stated", [None, [], {}, {"described": [3], "references": {}}, {"described": [{}]}])
def test_a_file_without_descriptions_is_refused(stated):
    with pytest.raises(InputError, match=r"described\.json does not hold descriptions"):
        Descriptions.from_dict(stated)
