"""Plug-ins: which file a name means, and what a change of a file next to it makes new."""

import shutil
import sys
from pathlib import Path

import pytest

from glossbench.errors import InputError
from glossbench.import_closure import find_local_files, is_installed
from glossbench.plugins import find_origin, import_plugin
from glossbench.provenance import compute_source_hash
from glossbench.run.runner import run_study
from glossbench.shading.method import METHODS
from glossbench.study.study import load_study


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    """Two folders, and a process that has loaded nothing of them."""
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    for folder in ("study", "here"):
        (tmp_path / folder).mkdir()
    monkeypatch.chdir(tmp_path / "here")
    with METHODS.isolated():
        yield
    for name, module in list(sys.modules.items()):
        if str(vars(module).get("__file__")).startswith(str(tmp_path)):
            del sys.modules[name]


@pytest.fixture
def study(tmp_path):
    return tmp_path / "study"


def write(folder, **files):
    for name, content in files.items():
        path = folder / f"{name.replace('__in__', '/')}.py"
        path.parent.mkdir(exist_ok=True)
        path.write_text(content)


# Which file.


def test_the_module_next_to_the_study_wins_over_that_of_the_working_folder(study):
    write(study, lab_a="PLACE = 'study'")
    write(Path.cwd(), lab_a="PLACE = 'here'")

    assert import_plugin("lab_a", study).PLACE == "study"
    assert find_origin("lab_a") == str(study / "lab_a.py")
    del sys.modules["lab_a"]
    assert import_plugin("lab_a").PLACE == "here"


def test_a_helper_next_to_the_study_wins_over_that_of_the_working_folder(study):
    write(study, lab_b="import lab_help\nPLACE = lab_help.PLACE", lab_help="PLACE = 'study'")
    write(Path.cwd(), lab_help="PLACE = 'here'")

    assert import_plugin("lab_b", study).PLACE == "study"


def test_a_file_next_to_the_study_wins_over_an_installed_module_that_is_not_loaded(study):
    write(study, xdist_of_mine="PLACE = 'study'")
    site = study.parent / "site-packages"
    site.mkdir()
    write(site, xdist_of_mine="PLACE = 'site'")
    sys.path.insert(0, str(site))

    assert import_plugin("xdist_of_mine", study).PLACE == "study"


@pytest.mark.parametrize("name", ["random", "queue", "json", "antigravity"])
def test_a_file_with_the_name_of_a_module_of_python_is_refused(study, name):
    write(study, **{name: "PLACE = 'study'"})

    with pytest.raises(InputError, match=rf"{name}\.py has the name of a module of Python itself; rename it$"):
        import_plugin(name, study)


def test_a_file_with_the_name_of_an_installed_module_that_is_loaded_is_refused(study):
    write(study, yaml="PLACE = 'study'")

    with pytest.raises(InputError, match=r"yaml\.py has the name of an installed module that is loaded already"):
        import_plugin("yaml", study)


def test_an_installed_module_needs_no_file(study):
    assert import_plugin("json", study) is sys.modules["json"]


def test_a_plugin_that_is_not_there_says_where_it_was_looked_for(study):
    with pytest.raises(InputError) as caught:
        import_plugin("lab_none", study)
    assert str(caught.value) == f"no such module: not in {study} nor {Path.cwd()}, nor installed"

    write(study, lab_c__in____init__="")
    with pytest.raises(InputError, match=r"no such module: lab_c is .*__init__\.py, which does not contain it$"):
        import_plugin("lab_c.none", study)


def test_what_a_plugin_misses_itself_is_named(study):
    write(study, lab_d="import no_such_library")

    with pytest.raises(ModuleNotFoundError, match="no_such_library"):
        import_plugin("lab_d", study)
    assert "lab_d" not in sys.modules


def test_two_studies_of_one_process_have_each_their_own_plugin_and_helper(study):
    other = study.parent / "other"
    other.mkdir()
    for folder in (study, other):
        write(folder, lab_e="from lab_tool import PLACE", lab_tool=f"PLACE = {folder.name!r}")

    assert [import_plugin("lab_e", folder).PLACE for folder in (study, other, study)] == ["study", "other", "study"]


def test_a_plugin_is_loaded_once_while_its_files_stay(study):
    write(study, lab_f="import lab_part\nPLACE = lab_part.PLACE", lab_part="PLACE = 1")
    first = import_plugin("lab_f", study)

    assert import_plugin("lab_f", study) is first
    write(study, lab_part="PLACE = 22")
    assert import_plugin("lab_f", study).PLACE == 22


# What decides.

PLUGIN = """
import torch
from glossbench.shading.method import METHODS, Method
{use}

@METHODS.register("flat_of_a_helper")
class Flat(Method):
    def shade(self, points, material):
        return torch.full((len(points), 3), float(level()))
"""
IMPORTS = {
    "a module": ("from tool import level", {"tool": "level = lambda: {}"}),
    "a whole module": ("import tool\nlevel = tool.level", {"tool": "level = lambda: {}"}),
    "a helper of a helper": (
        "from outer import level", {"outer": "from tool import level", "tool": "level = lambda: {}"}),
    "inside a function": ("def level():\n    import tool\n    return tool.level()", {"tool": "level = lambda: {}"}),
    "a literal name": (
        "import importlib\nlevel = importlib.import_module('tool').level", {"tool": "level = lambda: {}"}),
    "a package": ("from kit.deep import level", {"kit__in____init__": "", "kit__in__deep": "level = lambda: {}"}),
    "the first file of a package": (
        "from kit import level",
        {"kit__in____init__": "from .deep import level", "kit__in__deep": "level = lambda: {}"}),
    "a package without a first file": ("from kit.deep import level", {"kit__in__deep": "level = lambda: {}"}),
    "a file that no import names, of a package": (
        "from kit import level", {"kit__in____init__": "from . import deep\nlevel = deep.level",
                                  "kit__in__deep": "level = lambda: {}"}),
}  # fmt: skip


@pytest.mark.parametrize("name", IMPORTS)
def test_a_changed_helper_makes_its_class_another(study, name):
    use, files = IMPORTS[name]

    def written(level):
        write(study, lab_g=PLUGIN.format(use=use), **{each: code.format(level) for each, code in files.items()})
        return compute_source_hash(import_plugin("lab_g", study).Flat)

    first, again, second = written(1), written(1), written(2)

    assert first == again != second


def test_a_file_that_is_not_imported_makes_nothing_new(study):
    write(study, lab_h=PLUGIN.format(use="level = lambda: 1"), other="A = 1")
    before = compute_source_hash(import_plugin("lab_h", study).Flat)

    write(study, other="A = 2")

    assert compute_source_hash(import_plugin("lab_h", study).Flat) == before


def test_another_folder_makes_nothing_new(study):
    write(study, lab_i=PLUGIN.format(use="from tool import level"), tool="level = lambda: 1")
    before = compute_source_hash(import_plugin("lab_i", study).Flat)
    moved = Path(shutil.move(study, study.parent / "moved"))

    assert compute_source_hash(import_plugin("lab_i", moved).Flat) == before


def test_what_is_installed_is_not_part_of_a_plugin(study):
    write(study, lab_j="import torch, json, glossbench.shading.method, tool", tool="import numpy")

    assert find_local_files("lab_j", study / "lab_j.py").keys() == {"lab_j", "tool"}
    assert is_installed(Path(pytest.__file__))
    assert not is_installed(study)


STUDY = """
title: T
light: {constant: {}}
material: {ggx: {alpha: 0.5}}
view: {sphere: {resolution: 4}}
methods: flat_of_a_helper
reference: {relative_error: 0.2}
metrics: [mean_error]
plugins: [lab_k]
"""


def test_a_changed_helper_gives_new_numbers_in_the_same_folder(study):
    write(study, lab_k=PLUGIN.format(use="from tool import level"))
    (study / "s.yaml").write_text(STUDY)
    errors = []

    for level in (1, 1, 3):
        write(study, tool=f"level = lambda: {level}")
        results = run_study(load_study(study / "s.yaml"), Path("results"))
        errors.append(float(results.cells["mean_error"].iloc[0]))

    assert errors[1] == errors[0]
    assert errors[2] == pytest.approx(errors[0] + 2, abs=1e-6)
    assert results.provenance["plugins"] == {"lab_k": str(study / "lab_k.py")}
