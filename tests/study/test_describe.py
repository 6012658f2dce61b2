"""What a study says in words: its sweeps, its materials, and what each claim is about."""

import pytest
import torch

from glossbench.study.claim_counts import Count, count_claims
from glossbench.study.describe import describe_contents
from glossbench.study.study import Study, load_study, load_study_with_forms

STUDY = {
    "title": "T",
    "light": "{constant: {resolution: 8}}",
    "material": "{ggx: {alpha: 0.5}}",
    "view": "{sphere: {resolution: 4}}",
    "methods": "[{importance_sampling: {samples: [4, 8]}}, {environment_sampling: {samples: [4, 8, 16]}}]",
}


@pytest.fixture
def write(tmp_path):
    def written(**changes: str):
        path = tmp_path / "my.yaml"
        path.write_text("".join(f"{key}: {value}\n" for key, value in (STUDY | changes).items()))
        return path

    return written


@pytest.fixture
def words(write):
    def of(key: str, **changes: str) -> str:
        return describe_contents(*load_study_with_forms(write(**changes)))[key]

    return of


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ("{ggx: {alpha: 0.2}}", "ggx: alpha 0.2 (isotropic)"),
        ("{ggx: {alpha: [0.05, 0.2]}}", "ggx: alpha [0.05, 0.2] (one anisotropic material)"),
        ("{ggx: {alpha: [0.2, 0.2]}}", "ggx: alpha 0.2 (isotropic)"),
        ("{ggx: {alpha: [[0.05, 0.2]]}}", "ggx: alpha [0.05, 0.2] (one anisotropic material)"),
        ("{ggx: {alpha: [0.1, 0.2, 0.3]}}", "ggx: alpha 0.1, 0.2, 0.3 (isotropic) -> 3 materials"),
        (
            "{ggx: {alpha: [[0.1, 0.1], [0.1, 0.2]]}}",
            "ggx: alpha 0.1 (isotropic), [0.1, 0.2] (anisotropic) -> 2 materials",
        ),
        (
            "{ggx: {alpha: [0.1, 0.2, 0.3], f0: [0.04, 0.9]}}",
            "ggx: alpha 0.1, 0.2, 0.3 (isotropic); f0 0.04, 0.9 -> 6 materials",
        ),
        ("[ggx, {kurt: {m: 0.3}}]", "ggx\nkurt: m 0.3 (isotropic)"),
    ],
)
def test_a_material_is_described_in_words(words, stated, said):
    assert words("material", material=stated) == said


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ("importance_sampling", "importance_sampling"),
        ("{importance_sampling: {samples: [1, 2], seed: [1, 2, 3]}}",
         "importance_sampling: samples 1, 2; seed 1, 2, 3 -> 6 methods"),
        ("{regular_sampling: {zip: {samples: [17, 64], xi: [0.2, 0.05]}}}",
         "regular_sampling: samples and xi together (17, 0.2), (64, 0.05) -> 2 methods"),
        ("{regular_sampling: {mip_bias: {tune: rms, range: [0, 2]}}}",
         "regular_sampling: mip_bias tuned for the least rms in [0, 2]"),
        (f"{{importance_sampling: {{samples: {list(range(1, 1001))}}}}}",
         "importance_sampling: samples 1, 2, 3, 4, 5, 6, 7, 8 and 992 more -> 1,000 methods"),
    ],
)  # fmt: skip
def test_the_sweep_of_a_method_is_said_with_what_it_multiplies_to(words, stated, said):
    assert words("methods", methods=stated) == said


def test_a_light_of_a_file_is_called_by_its_path(words, tmp_path):
    from glossbench.envmap.formats.files import write_exr

    write_exr(tmp_path / "probe.exr", torch.ones(8, 16, 3))

    assert words("light", light="{file: {file: probe.exr, scale: 2}}") == f"{tmp_path}/probe.exr: scale 2"


def test_exclude_says_how_many_cells_are_left_out(words):
    assert words("exclude", exclude="[{samples: 4}, {method: environment_sampling, samples: 8}]") == "3 cells of 5"


def test_a_missing_device_is_reported(words, monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)

    assert words("device", device="cuda") == "cuda: this machine has none, so `run` refuses the study"


def about(write, claim: str, **changes: str) -> list[Count]:
    study: Study = load_study(write(claims=f"[{{text: A, {claim}}}]", **changes))
    return count_claims(study)


PAIR = "lower: importance_sampling, than: environment_sampling, metric: rms"


@pytest.mark.parametrize(
    ("claim", "count"),
    [
        (PAIR, Count(2, "pair")),  # 4 and 8 samples; 16 has no partner
        (f"{PAIR}, where: {{samples: 4}}", Count(1, "pair")),
        ("lower: {importance_sampling: {samples: 4}}, than: environment_sampling, metric: rms", Count(3, "pair")),
        ("lower: {importance_sampling: {samples: 4}}, than: {importance_sampling: {samples: 8}}, metric: rms",
         Count(1, "pair")),
        ("value: environment_sampling, of: rms, equals: 0", Count(3, "cell")),
        ("slope: environment_sampling, over: samples, metric: rms, between: [-1, 0]", Count(3, "cell")),
        ("slope: importance_sampling, over: samples, metric: rms, between: [-1, 0]",
         Count(2, "cell", "a slope needs 3 values of samples, and has 2")),
    ],
)  # fmt: skip
def test_a_claim_is_about_so_many_cells_or_pairs(write, claim, count):
    assert about(write, claim) == [count]


@pytest.mark.parametrize(
    ("points", "more", "n"),
    [("random", "", 1), ("hammersley", "", 4), ("random", ", paired_by: seed", 2), ("random", ", where: {seed: 1}", 1)],
)
def test_several_seeds_of_random_points_are_one_pair(write, points, more, n):
    of = f"samples: 4, points: {points}, seed: [1, 2]"
    methods = f"[{{importance_sampling: {{{of}}}}}, {{environment_sampling: {{{of}}}}}]"

    assert about(write, PAIR + more, methods=methods) == [Count(n, "pair")]


def test_a_claim_whose_sides_never_pair_is_reported_as_untestable(words):
    exclude = "[{method: importance_sampling, samples: 8}, {method: environment_sampling, samples: 4}]"

    said = words("claims", claims=f"[{{text: A, {PAIR}, paired_by: samples}}]", exclude=exclude)

    assert said == ("0 pairs: A (cannot be tested: no cell of one side has a counterpart with the same "
                    "light, material, view, samples)")  # fmt: skip


def test_the_pairs_that_are_counted_are_those_that_the_verdict_finds(write):
    """Twin of the counts above: the same claims, judged on rows that all have a number."""
    import pandas

    from glossbench.findings.verdicts import judge

    study = load_study(write(claims=f"[{{text: A, {PAIR}}}, {{text: B, {PAIR}, where: {{samples: 8}}}}]"))
    rows = [cell.make_record(metrics={"rms": 1.0}, n_samples=1).to_row() for cell in study.cells()]

    verdicts = judge(study.claims, pandas.DataFrame(rows))

    assert [len(verdict["numbers"]) for verdict in verdicts] == [count.n for count in count_claims(study)]
