"""The import closure of a module: the files that it needs, and no file for which a package only hands names on."""

from pathlib import Path

import pytest

from glossbench import source_tree
from glossbench.import_closure import find_source_files
from glossbench.provenance import compute_code_hash, compute_source_hash
from glossbench.source_imports import ImportedName, read_source
from glossbench.source_tree import SourceTree

FILES = {
    "__init__": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from lab.ground import zero",
    "ground": "zero = 0",
    "other": "one = 1",
    "facade/__init__": (
        "from lab.facade.near import near\nfrom lab.ground import zero\nfrom lab.other import one\nown = 3"
    ),
    "facade/near": "near = 2",
    "first": "",
}


@pytest.fixture
def needs(tmp_path):
    """What a module of this source needs of the package `lab`, as names without "lab."."""

    def needs(source):
        for name, text in {**FILES, "first": source}.items():
            file = tmp_path / "lab" / f"{name}.py"
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text)
        closure = SourceTree("lab", tmp_path / "lab").find_closure([ImportedName("lab.first")])
        assert all(path.is_file() for path in closure.values())
        return {name.removeprefix("lab.") for name in closure} - {"first"}

    return needs


CASES = {
    "a name that a package hands on": ("from lab.facade import zero", {"ground"}),
    "two of them": ("from lab.facade import near, one as uno", {"facade.near", "other"}),
    "a name that a package defines": ("from lab.facade import own", {"facade", "facade.near", "ground", "other"}),
    "a module of a package": ("from lab.facade import near as module", {"facade.near"}),
    "a whole package": ("import lab.facade", {"facade", "facade.near", "ground", "other"}),
    "a relative name": ("from .facade import zero", {"ground"}),
    "a relative module": ("from . import other", {"other"}),
    "a name stated for types": ("from lab import zero", {"ground"}),
    "the outermost package": ("import lab as l\nl.zero", {"lab", "ground"}),
    "inside a function": ("def f():\n    with open('x'):\n        from lab.other import one", {"other"}),
    "in the branches of a try": ("try:\n    pass\nexcept OSError:\n    import lab.other", {"other"}),
    "in a case": ("match 1:\n    case 1:\n        import lab.other", {"other"}),
    "a literal name": ("import importlib\nimportlib.import_module('lab.other')", {"other"}),
    "for types alone": ("import typing\nif typing.TYPE_CHECKING:\n    import lab.other\nelse:\n    import lab.ground",
                        {"ground"}),
    "of nothing": ("import lab.missing\nfrom lab.facade import missing\nimport torch",
                   {"facade", "facade.near", "ground", "other"}),
    "in a text": ("'''\nimport lab.other\n'''", set()),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_a_module_needs_what_it_imports(name, needs):
    source, needed = CASES[name]

    assert needs(source) == needed


def test_a_module_that_cannot_be_parsed_needs_itself_alone(needs):
    assert needs("import lab.other\ndef") == set()


def test_modules_that_import_each_other_are_found_once(needs, monkeypatch):
    monkeypatch.setitem(FILES, "other", "import lab.first")

    assert needs("import lab.other") == {"other"}


def test_the_imports_of_glossbench_itself_are_read_without_its_package_running():
    source = read_source(Path(source_tree.__file__), "glossbench")

    assert ImportedName("glossbench.source_imports", "ImportedName") in source.imports


PLUGIN = """
from glossbench.prefilter import METHODS, Method, median_cut
class Mine(Method):
    pass
"""


def test_a_plug_in_needs_what_it_takes_of_glossbench(tmp_path):
    file = tmp_path / "lab_of_mine.py"
    file.write_text(PLUGIN)

    found = find_source_files("lab_of_mine", file)

    assert found["lab_of_mine"] == file
    assert {"glossbench.prefilter.median_cut", "glossbench.shading.method", "glossbench.registry"} <= found.keys()
    assert not {"glossbench.prefilter", "glossbench.prefilter.stages", "glossbench.truth.reference"} & found.keys()


def test_methods_of_a_checkout_are_found_where_they_lie():
    closure = source_tree.GLOSSBENCH.find_closure([ImportedName("glossbench.methods.importance_sampling")])

    assert closure["glossbench.methods.importance_sampling"].parts[-2:] == ("methods", "importance_sampling.py")


def test_another_version_of_torch_makes_another_hash(monkeypatch):
    before = compute_code_hash("glossbench.channels")
    compute_code_hash.cache_clear()
    monkeypatch.setattr("glossbench.provenance.version", lambda name: "9.9" if name == "torch" else "1.0")

    try:
        assert compute_code_hash("glossbench.channels") != before
    finally:
        compute_code_hash.cache_clear()


def test_a_class_without_a_file_has_one_hash_per_process_that_no_other_class_has():
    first, second = (type("Typed", (), {"__module__": "nowhere"}) for _ in range(2))

    assert compute_source_hash(first) == compute_source_hash(first) != compute_source_hash(second)
