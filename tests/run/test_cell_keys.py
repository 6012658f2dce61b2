"""A cell's key knows the source that the cell uses, and no other."""

import shutil
from contextlib import contextmanager, nullcontext
from pathlib import Path

import pytest

from glossbench import source_tree
from glossbench.provenance import compute_code_hash
from glossbench.run.cell_keys import CellKeys
from glossbench.run.results import Results
from glossbench.run.study_lights import StudyLights
from glossbench.source_tree import SourceTree
from glossbench.study.study import load_study

ROOT = Path(__file__).resolve().parents[2]
STUDY = """
title: T
light: {constant: {resolution: 4}}
material: [kurt: {m: 0.3}, ggx: {alpha: 0.3}, sum: {of: [phong: {s: 20}]}]
view: {sphere: {resolution: 4}}
methods: [importance_sampling, regular_sampling, filtered_importance_sampling, brdf_factorization, many_lights]
reference: {relative_error: 0.2}
metrics: [mean_error]
"""
METHODS = {
    "importance_sampling", "regular_sampling", "filtered_importance_sampling", "brdf_factorization", "many_lights",
}  # fmt: skip
EVERY = {(material, method) for material in ("kurt", "ggx", "sum") for method in METHODS}


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """The project's Python files as a wheel lays them out."""
    folder = tmp_path_factory.mktemp("copy") / "glossbench"
    for source, target in ((ROOT / "glossbench", folder), (ROOT / "methods", folder / "methods")):
        shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"))
    return folder


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    file = tmp_path_factory.mktemp("study") / "study.yaml"
    file.write_text(STUDY)
    return load_study(file)


@pytest.fixture
def keys(copy, study, tmp_path, monkeypatch):
    """The keys of all cells, by material and method, of the source that lies in the copy now."""

    def keys():
        monkeypatch.setattr(source_tree, "GLOSSBENCH", SourceTree("glossbench", copy))
        compute_code_hash.cache_clear()
        found = CellKeys(study, Results(tmp_path), StudyLights("cpu", tmp_path), lambda cell, key: nullcontext())
        return {(cell.material.name, cell.method.name): found.identify(cell).key for cell in study.cells()}

    yield keys
    compute_code_hash.cache_clear()


@contextmanager
def commented(file):
    text = file.read_text()
    file.write_text(f"{text}# A comment.\n")
    yield
    file.write_text(text)


def made_new(keys, file):
    """The cells that a comment in a file makes new."""
    before = keys()
    with commented(file):
        after = keys()
    assert before.keys() == after.keys() == EVERY
    return {cell for cell in EVERY if before[cell] != after[cell]}


def of(material=None, methods=METHODS):
    return {cell for cell in EVERY if material in (None, cell[0]) and cell[1] in methods}


NEW = {
    "methods/regular_sampling.py": of(methods={"regular_sampling"}),
    "methods/brdf_factorization/__init__.py": of(methods={"brdf_factorization"}),
    "methods/brdf_factorization/factors.py": of(methods={"brdf_factorization"}),
    "methods/filtered_importance_sampling/visibility_harmonics.py": of(methods={"filtered_importance_sampling"}),
    "methods/lighting_factorization/factors.py": set(),
    "prefilter/median_cut.py": of(methods={"brdf_factorization", "many_lights"}),
    "prefilter/__init__.py": set(),
    "brdf/ggx.py": of("ggx"),
    "brdf/ward.py": set(),
    "brdf/phong.py": of("sum"),  # which names its materials in the study
    "envmap/cubemap.py": EVERY,
    "envmap/lights/synthetic.py": EVERY,
    "envmap/lights/sky.py": set(),
    "envmap/lights/file_light.py": set(),
    "envmap/formats/exr.py": set(),
    "scene/sphere.py": EVERY,
    "metrics/pixelwise.py": EVERY,
    "metrics/perceptual.py": set(),
    "shading/method.py": EVERY,
    "shading/image.py": EVERY,
    "truth/reference.py": EVERY,
    "run/tuning.py": EVERY,
    "commands/printing.py": set(),
    "findings/verdicts.py": set(),
    "study/document.py": set(),
    "run/results.py": set(),
}


@pytest.mark.parametrize("file", NEW)
def test_a_comment_makes_new_only_the_cells_that_use_its_file(file, copy, keys):
    assert made_new(keys, copy / file) == NEW[file]


FAULTS = {
    "the whole façade": (
        "_find_definitions",
        lambda self, imported: iter([imported.module]),
        "prefilter/median_cut.py",
    ),
    "no depth": ("_find_needs", lambda self, module, file: (), "envmap/cubemap.py"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_the_check_notices_a_closure_that_follows(fault, copy, keys, monkeypatch):
    name, planted, file = FAULTS[fault]
    monkeypatch.setattr(SourceTree, name, planted)

    assert made_new(keys, copy / file) != NEW[file]


def test_the_check_notices_a_key_without_the_parts_of_a_sum(copy, keys, monkeypatch):
    monkeypatch.setattr("glossbench.brdf.mixture.compute_source_hash", lambda cls: "")

    assert made_new(keys, copy / "brdf/phong.py") == set()


def test_the_metric_of_tuning_and_rms_are_part_of_a_key(study, tmp_path):
    tuned = tmp_path / "study.yaml"
    tuned.write_text(STUDY.replace(", regular_sampling,", ", regular_sampling: {xi: {tune: mrse, range: [0.1, 0.3]}},"))

    by_method = {cell.method.name: cell for cell in load_study(tuned).cells()}
    metrics = {
        name: [metric for metric, *_ in CellKeys(
            study, Results(tmp_path), StudyLights("cpu", tmp_path), lambda cell, key: nullcontext()
        ).sources.list_by_kind(cell)["metrics"]] for name, cell in by_method.items()
    }  # fmt: skip

    assert metrics["many_lights"] == ["mean_error", "rms"]
    assert metrics["regular_sampling"] == ["mean_error", "rms", "mrse"]
