"""The document on studies is right: each of its parts is read, and makes what the document states."""

import re
from pathlib import Path

import pytest
import yaml

from glossbench.run.runner import run_study
from glossbench.study.cells import Tuning
from glossbench.study.claim_counts import Count, count_claims
from glossbench.study.schema import StudyKeys
from glossbench.study.study import Study, load_study

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "write-a-study.md"
TEXT = DOCUMENT.read_text(encoding="utf-8")
BASE, *PARTS = (yaml.safe_load(block) for block in re.findall(r"^```yaml\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL))


@pytest.fixture
def study(tmp_path):
    """The document's study, with its part that states a key and, if asked for, holds a word."""

    def of(key: str = "", word: str = "", **changes: object) -> Study:
        found = [part for part in PARTS if key in part and word in str(part)] if key else [{}]
        path = tmp_path / "my_study.yaml"
        path.write_text(yaml.safe_dump(BASE | found[0] | changes, sort_keys=False))
        return load_study(path)

    return of


@pytest.mark.parametrize("part", PARTS, ids=[f"{i} {next(iter(part))}" for i, part in enumerate(PARTS)])
def test_every_part_of_the_document_is_read(part, tmp_path):
    claims = {} if "claims" in part or "methods" not in part else {"claims": []}
    path = tmp_path / "my_study.yaml"
    path.write_text(yaml.safe_dump(BASE | claims | part, sort_keys=False))
    slopes = [claim for claim in part.get("claims", []) if "slope" in claim]

    loaded = load_study(path)

    assert loaded.cells()
    assert [count.problem for count in count_claims(loaded) if count.problem] == [
        "a slope needs 3 values of samples, and has 2" for _ in slopes
    ]


def test_the_first_study_makes_twelve_cells_and_six_pairs(study):
    assert len(study().cells()) == 12
    assert count_claims(study()) == [Count(6, "pair")]


def test_the_first_study_runs_and_its_claim_has_a_verdict(study, tmp_path):
    small = {"material": {"ggx": {"alpha": 0.4}}, "view": {"sphere": {"resolution": 8}}}

    results = run_study(study(**small, reference={"relative_error": 0.2}), tmp_path / "results")

    assert [claim["verdict"] for claim in results.claims] in (["holds"], ["does not hold"], ["equal"], ["within noise"])
    assert len(results.cells) == 4


def test_two_lists_make_six_methods_and_eighteen_cells(study):
    swept = study("methods", "seed", claims=[])

    assert (len(swept.methods), len(swept.cells())) == (6, 18)


def test_one_pair_is_one_anisotropic_material_and_pairs_in_a_list_are_several(study):
    widths = [item.as_dict()["alpha"] for item in study("material", "ggx").materials]

    assert widths == [[0.1, 0.4], [0.1, 0.1], [0.4, 0.4], [0.2, 0.1], [0.3, 0.1]]


def test_zip_pairs_and_multiplies_with_other_lists(study):
    options = [item.method.as_dict() for item in study("methods", "zip", claims=[]).methods]

    assert [(o["samples"], o["xi"], o["mip_bias"]) for o in options] == [
        (17, 0.2, 0.0), (17, 0.2, 1.0), (64, 0.05, 0.0), (64, 0.05, 1.0)
    ]  # fmt: skip


def test_a_tuned_option_is_searched_between_its_bounds_or_those_stated(study):
    tuned = [item.tune for item in study("methods", "tune", claims=[]).methods]

    assert tuned == [Tuning("mip_bias", "rms", -4, 4), Tuning("mip_bias", "flip", -1, 1)]


def test_the_exclusions_leave_out_the_cells_that_are_said(study):
    assert len(study("exclude").cells()) == 12 - 3 - 4


def test_where_with_a_number_is_the_isotropic_pair(study):
    claim = {"text": "A", "value": "importance_sampling", "of": "rms", "equals": 1, "where": {"alpha": 0.2}}

    assert count_claims(study(claims=[claim])) == [Count(2, "cell")]


def test_the_claim_on_rougher_materials_is_about_two_pairs(study):
    assert count_claims(study("claims", "rougher")) == [Count(2, "pair")]


def test_sides_that_state_a_material_are_compared_with_each_other(study):
    # Each 2 budgets: of 3 materials; of 2 filters on each side, at equal budgets.
    assert count_claims(study("claims", "easier")) == [Count(6, "pair"), Count(8, "pair")]


def test_the_document_names_every_key_of_a_study_and_of_a_claim():
    missing = [key for key in StudyKeys.model_fields if f"{key}:" not in TEXT and f"`{key}`" not in TEXT]

    assert missing == []
    assert all(f"{kind}:" in TEXT for kind in ("lower", "ratio", "value", "slope", "where", "than", "over", "between"))
