"""Looking things up: validate, schema, info, version and help."""

import json
from importlib.metadata import version as system_version
from inspect import cleandoc
from typing import Any

import pytest
import yaml

from glossbench.catalog.entries import list_entries
from glossbench.commands.schema_words import describe_values as words_of_schema
from glossbench.options import list_options
from glossbench.study.registries import REGISTRIES
from glossbench.study.study_files import find_study_files
from oracles.command_line import STUDY, files_under, words

pytestmark = pytest.mark.usefixtures("here")


VALIDATED = """\
Tiny: 1 light, 1 material, 1 view, 4 cells, 1 claim
light     gradient: resolution 16
material  ggx: alpha 0.5 (isotropic)
view      sphere: resolution 8
methods   importance_sampling: samples 4, 8 -> 2 methods
          environment_sampling: samples 4, 8 -> 2 methods
metrics   rms, relative_rms, mean_error, max_error
device    cpu
claims    2 pairs: A [b] /c

"""


def test_validate_says_what_a_study_makes_and_writes_nothing(call, here):
    before = files_under(here)

    assert call("validate", "tiny.yaml") == (0, VALIDATED, "")
    assert files_under(here) == before


@pytest.mark.parametrize("name", find_study_files())
def test_every_installed_study_is_valid(call, name):
    code, _, err = call("validate", name)

    # A study of files that are not here says which.
    assert code == 0 or "no image file" in err


def test_schema_prints_a_json_schema_of_every_key(call):
    code, out, err = call("schema")

    stated = json.loads(out)
    assert (code, err) == (0, "")
    assert stated["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    assert set(STUDY) <= set(stated["properties"])
    assert_is_schema(stated)


def assert_is_schema(stated: Any) -> None:
    """The rules of the draft for the keywords that are used; an unknown keyword is a fault, too."""
    texts = {"$schema", "$ref", "title", "description", "pattern"}
    types = {"object", "array", "string", "number", "integer", "boolean", "null"}
    numbers = {"minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum"}
    counts = {"minItems", "maxItems", "minLength", "minProperties", "maxProperties"}
    for key, value in stated.items():
        if key in texts:
            assert isinstance(value, str)
        elif key == "type":  # one, or several that are all allowed
            named = value if isinstance(value, list) else [value]
            assert named
            assert len(set(named)) == len(named)
            assert set(named) <= types
        elif key in numbers:
            assert isinstance(value, int | float)
        elif key in counts:
            assert isinstance(value, int)
            assert value >= 0
        elif key in ("properties", "patternProperties", "$defs"):
            for one in value.values():
                assert_is_schema(one)
        elif key in ("anyOf", "oneOf", "prefixItems"):
            assert value
            for one in value:
                assert_is_schema(one)
        elif key in ("items", "additionalProperties", "propertyNames"):
            if not isinstance(value, bool):
                assert_is_schema(value)
        elif key == "required":
            assert len(set(value)) == len(value)
        elif key == "enum":
            assert isinstance(value, list)
        else:
            assert key in ("default", "const"), key


@pytest.mark.parametrize(
    "fault", [{"type": "text"}, {"type": ["object", "text"]}, {"minItems": -1}, {"anyOf": []}, {"propertys": {}}]
)
def test_a_wrong_schema_would_be_noticed(fault):
    """Twin of the above."""
    with pytest.raises(AssertionError):
        assert_is_schema({"properties": {"a": fault}})


def test_info_lists_every_name(call):
    code, out, _ = call("info")

    assert code == 0
    for registry in REGISTRIES.values():
        assert all(name in words(out).replace(",", "").split() for name in registry.names())
    assert all(name in words(out) for name in find_study_files())
    lines = [line for line in out.splitlines() if line]
    assert {line[:13].strip() for line in lines} == {"", *REGISTRIES, "study", "public file"}  # names stand apart


@pytest.mark.parametrize("kind", REGISTRIES)
def test_info_prints_docstring_and_options_of_every_name(call, kind):
    registry = REGISTRIES[kind]

    for name in registry.names():
        code, out, err = call("info", name)

        cls = registry.get(name)
        assert (code, err) == (0, "")
        assert cls.__doc__, f"{kind} {name} has no docstring"
        assert words(cleandoc(cls.__doc__)) in words(out)
        rows = {line.split()[0] for line in out.splitlines() if line.strip()}
        assert set(list_options(cls)) <= rows


def test_info_of_a_study_says_what_it_asks_and_claims(call):
    code, out, err = call("info", "quickstart")

    stated = yaml.safe_load(find_study_files()["quickstart"].read_text())
    assert (code, err) == (0, "")
    assert all(words(text) in words(out) for text in (stated["title"], stated["question"], stated["source"]))
    assert all(claim["text"] in out for claim in stated["claims"])


def test_info_of_a_public_file_says_all_that_the_catalogue_does(call):
    for stated in list_entries():
        code, out, err = call("info", stated.name)

        assert (code, err) == (0, "")
        for value in (stated.url, stated.licence, stated.sha256, str(stated.bytes), stated.stresses):
            assert value in out
        assert f"no; glossbench data fetch {stated.name}" in out


def test_info_of_a_name_of_two_kinds_shows_both(call):
    out = call("info", "grace_cross").out

    assert "grace_cross (light)" in out
    assert "grace_cross (environment, public file)" in out


def test_info_of_a_metric_says_its_formula_and_unit(call):
    out = words(call("info", "rms").out)

    assert "formula sqrt(mean((x - y)^2))" in out
    assert "unit radiance" in out
    assert "lower is better yes" in out


@pytest.mark.parametrize(
    ("rule", "said"),
    [
        ({"type": "integer", "minimum": 1, "maximum": 1048576}, "integer >= 1, <= 1048576"),
        ({"type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": 1}, "number > 0, < 1"),
        ({"anyOf": [{"enum": ["a", "b"]}, {"type": "null"}]}, "a, b or none"),
        ({"const": "a"}, "a"),
        ({"prefixItems": [{"type": "number"}, {"type": "number"}]}, "2 x number"),
        ({"type": "array", "items": {"type": "boolean"}}, "list of boolean"),
        ({}, "any"),
    ],
)
def test_bounds_are_stated_in_full(rule, said):
    assert words_of_schema(rule) == said


def test_version(call):
    assert call("--version") == (0, f"glossbench {system_version('glossbench')}\n", "")


@pytest.mark.parametrize(
    "command",
    ["run", "report", "figure", "validate", "schema", "info", "light", "data", "data list", "data fetch",
     "check-method", "bench", "sys-info"],
)  # fmt: skip
def test_every_command_explains_itself(call, command):
    code, out, err = call(*command.split(), "--help")

    assert (code, err) == (0, "")
    assert "Usage: " in out
    assert out.count("\n") > 5


@pytest.mark.parametrize("name", ["regular_sampling", "importance_sampling"])
def test_info_has_the_formula_in_plain_letters_and_not_in_the_notation_of_print(call, name):
    out = call("info", name).out

    assert "Lo ~ (1/N) sum of" in out
    assert "approx" not in out
    assert "sum_(i=1)" not in out
