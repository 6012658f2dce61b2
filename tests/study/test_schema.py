"""The JSON Schema of studies: it takes what `glossbench run` takes, and not what that refuses."""

import copy
import json

import jsonschema
import pytest
import yaml

from glossbench.documentation import read_attributes
from glossbench.metrics import METRICS
from glossbench.options import list_options
from glossbench.study.schema import REGISTRIES, schema
from glossbench.study.shared_schema import share_parts
from glossbench.study.study_files import find_study_files

STUDY = {
    "title": "T",
    "light": "spots",
    "material": {"ggx": {"alpha": 0.5}},
    "view": "sphere",
    "methods": [{"regular_sampling": {"samples": [14, 17], "mip_bias": {"tune": "rms", "range": [-1, 1]}}}],
    "claims": [{"text": "A", "value": "regular_sampling", "of": "rms", "between": [None, 1]}],
}


@pytest.fixture(scope="module")
def stated():
    return schema()


@pytest.fixture(scope="module")
def validator(stated):
    jsonschema.Draft202012Validator.check_schema(stated)
    return jsonschema.Draft202012Validator(stated)


@pytest.mark.parametrize("name", find_study_files())
def test_every_installed_study_is_valid(validator, name):
    # The core schema of YAML 1.2 reads 1e-3 as a number, which PyYAML's own loader does not; studies write 1.0e-3.
    study = yaml.safe_load(find_study_files()[name].read_text(encoding="utf-8"))

    assert [error.message for error in validator.iter_errors(study)] == []


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"light": "probe.hdr"},
        {"light": [{"file": "probe.hdr"}, {"file": {"file": "probe.hdr", "scale": [1, 2]}}, {"spots": None}]},
        {"material": {"ggx": {"alpha": [[0.1, 0.1], 0.2]}}},
        {"material": {"sum": {"of": [{"kurt": {"m": 0.1}}, "phong"]}}},
        {"methods": {"regular_sampling": {"zip": {"samples": [14, 17], "xi": [0.1, 0.2]}}}},
        {"metrics": "rms"},
        {"exclude": [{"method": "regular_sampling", "samples": 14}]},
        {"device": "cuda", "seed": 5, "time_limit": 60, "plugins": ["my_lab.mine"], "reference": {"max_samples": 2048}},
        {"claims": [{"text": "A", "lower": {"regular_sampling": {"xi": 0.1}, "light": "sky"}, "than": "many_lights",
                     "metric": "rms", "where": {"light": [{"spots": {"seed": 1}}]}, "paired_by": "samples"}]},
    ],
)  # fmt: skip
def test_a_sound_study_is_valid(validator, changes):
    assert [error.message for error in validator.iter_errors(STUDY | changes)] == []


@pytest.mark.parametrize(
    "changes",
    [
        {"metric": "rms"},
        {"title": 3},
        {"methods": "regular_samplin"},
        {"methods": []},
        {"methods": {"regular_sampling": {"sample": 14}}},
        {"methods": {"regular_sampling": {"samples": "many"}}},
        {"methods": {"regular_sampling": {"samples": 0}}},
        {"methods": {"regular_sampling": {"samples": [14, 0]}}},
        {"methods": {"regular_sampling": {"mip_bias": {"tune": 3}}}},
        {"methods": {"regular_sampling": {"mip_bias": {"tune": "rms", "range": [1]}}}},
        {"methods": {"regular_sampling": {}, "many_lights": {}}},
        {"methods": {"regular_sampling": {"zip": {"samples": 14}}}},
        {"material": {"ggx": {"alpha": 1.5}}},
        {"material": {"ggx": {"alpha": {"tune": "rms"}}}},
        {"light": {"spot": None}},
        {"view": {"sphere": {"resolution": -1}}},
        {"metrics": ["rsm"]},
        {"metrics": []},
        {"device": "tpu"},
        {"seed": -1},
        {"reference": {"error": 1}},
        {"exclude": {"samples": 14}},
        {"claims": [{"text": "A"}]},
        {"claims": [{"text": "A", "higher": "a", "than": "b", "metric": "rms"}]},
        {"claims": [{"text": "A", "value": "a", "of": "rms", "when": 3}]},
    ],
)
def test_a_wrong_study_is_not_valid(validator, changes):
    assert not validator.is_valid(STUDY | changes)


def test_the_schema_is_small_enough_for_an_editor(stated):
    # Measured 216 kB as it is printed, of 18 methods.
    assert len(json.dumps(stated, indent=1)) < 250_000


def test_every_key_of_a_study_has_a_description(stated):
    keys = stated["properties"]

    assert [key for key, value in keys.items() if len(value.get("description", "")) < 5] == []


def test_every_option_says_what_it_is():
    undescribed = {
        f"{kind}.{name}.{option}"
        for kind, registry in {**REGISTRIES, "metric": METRICS}.items()
        for name in registry.names()
        if registry.get(name).__module__.startswith("glossbench.")
        for option in set(list_options(registry.get(name))) - set(read_attributes(registry.get(name)))
    }

    assert undescribed == set()


def test_an_option_carries_what_its_docstring_says(stated):
    assert "density, over its peak, at which the lobe is cut off." in json.dumps(stated)
    assert "texels along the edge of a face, a power of two." in json.dumps(stated)


def test_a_schema_without_repetition_means_the_same(validator, stated):
    """Twin: with its references put back it is the schema that it came from."""
    part = {
        "type": "object",
        "properties": {"a": {"type": "integer", "description": "x" * 90}},
        "description": "p" * 90,
    }
    whole = {"properties": {"one": part, "two": copy.deepcopy(part)}, "$defs": {}}

    found = share_parts(whole)

    assert list(found["$defs"]) == ["one", "one.a"]
    assert found["properties"]["one"] == found["properties"]["two"] == {"$ref": "#/$defs/one"}
    jsonschema.validate({"one": {"a": 1}}, found)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({"two": {"a": "text"}}, found)
