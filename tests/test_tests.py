"""The tests themselves: what they import, whose private names they use, and that each of them asserts something."""

import ast
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
SOURCES = {path.relative_to(TESTS): path.read_text(encoding="utf-8") for path in sorted(TESTS.rglob("*.py"))}
TEST_MODULES = {path.stem for path in SOURCES if path.stem.startswith("test_")}
EACH_FILE = [pytest.param(source, id=str(path)) for path, source in SOURCES.items()]


@cache
def nodes(source: str) -> list[ast.AST]:
    """All nodes of a source."""
    return [*ast.walk(ast.parse(source))]


def last_name(node: ast.expr) -> str:
    """The last name of a dotted one; nothing of another expression."""
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def test_the_walk_sees_the_tests():
    assert {Path("test_tests.py"), Path("envmap/test_cubemap.py"), Path("oracles/z_scores.py")} <= SOURCES.keys()


# What several tests use is in oracles: no test imports another.


def imported_tests(source: str) -> set[str]:
    """Test modules that a source imports, at any depth of its code."""
    found = set()
    for node in nodes(source):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {node.module or ""} | {alias.name for alias in node.names if node.level or not node.module}
    return {name for name in found if TEST_MODULES & set(name.split("."))}


@pytest.mark.parametrize("source", EACH_FILE)
def test_no_file_imports_a_test(source):
    assert imported_tests(source) == set()


@pytest.mark.parametrize(
    "source",
    [
        "import test_cubemap",
        "from test_cubemap import axis",
        "def f():\n    from tests.envmap.test_cubemap import axis",
    ],
)
def test_an_import_of_a_test_is_noticed(source):
    assert imported_tests(source)


# Private names of the project. A test knows the public ones; each that is left is here, with its reason.

PLANTED = "a fault is planted where the project does this"
ALLOWED = {
    # Faults that are planted inside, where no public name exists.
    "_balanced": PLANTED,
    "_classes": PLANTED,
    "_pair_all_blocks": PLANTED,
    "_expand": PLANTED,
    "_compute_jacobian": PLANTED,
    "_discovered": PLANTED,
    "_mark_fans": PLANTED,
    "_make_hashable": PLANTED,
    "_decode_scanlines": PLANTED,
    "_decode_records": PLANTED,
    "_shrinkage": PLANTED,
    "_axis": PLANTED,
    "_add_sun": PLANTED,
    "_place_sun_disc": PLANTED,
    "_PLAIN": PLANTED,
    # What is watched: how often something is done, which no result shows.
    "_round": "the rounds of a reference that is taken up again are counted",
    "_build_level_0": "a map that is not needed is not made",
    "_entries": "the cache holds one value, not copies of it",
    # What is stood in for.
    "_read_lines": "a control group of the system, which a test cannot make",
    "_CGROUPS": "a control group of the system, which a test cannot make",
    "_BLOCK": "the size above which a file is read in parts, which would be gigabytes",
    "_this_thread": "what is put back is not put back, as in the thread of a plug-in",
    "_report_writers": "reports that fail, or take no time, in place of the installed ones",
    "_FINE": "the size above which images are resampled more coarsely, which would take minutes",
    "_force_terminal": "a terminal, of the library that prints",
    "_color_system": "a terminal, of the library that prints",
    "_file": "standard error, of the library that prints",
    "_end": "how the command line ends, without the end of the process",
    # What is compared on its own.
    "_from_cosine": "one kernel of the reference is compiled, not all three",
    "_CONVENTIONS": "every convention is tested, whichever there are",
    "_OZONE": "a table of the sky's paper, which the tests' own formula reads too",
    "_SOLAR": "a table of the sky's paper, which the tests' own formula reads too",
    "_describe_regions": "the sums of given regions, without the cut that finds them",
    "_make_rings": "the quadrature of a calibration, against the closed form",
    # Reports, whose pictures take most of the time of a test of text.
    "_arrange_plots": "no plots", "_arrange_images": "no images", "_compute_flip": "a map is not made again",
    "_describe_methods": "no methods",
    "_load_templates": "past its cache", "_to_halves": "coded numbers", "_area_weights": PLANTED,
    "_plot_at": "the captions of plots, without setting a PDF", "_read": "no folder",
    "_swept": "what a figure sweeps", "_compiler": "the typesetter's own words",
}  # fmt: skip
OF_NAMED_TUPLES = {"_replace", "_asdict", "_fields", "_make"}


def is_private(name: str) -> bool:
    return name.startswith("_") and not name.startswith("__") and name not in OF_NAMED_TUPLES


def private_names(source: str) -> set[str]:
    """Private names of others that a source reads, imports, or replaces by name; not those of its own `self`."""
    found = set()
    for node in nodes(source):
        if isinstance(node, ast.Attribute):
            if is_private(node.attr) and ast.unparse(node.value) not in ("self", "cls", "os", "super()"):
                found.add(node.attr)
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "glossbench":
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.Call) and last_name(node.func) in ("setattr", "delattr", "getattr"):
            words = [a.value for a in node.args[:2] if isinstance(a, ast.Constant) and isinstance(a.value, str)]
            found |= {word.split(".")[-1] for word in words}
    return {name for name in found if is_private(name)}


@pytest.mark.parametrize("source", EACH_FILE)
def test_private_names_are_used_only_for_a_stated_reason(source):
    assert private_names(source) - ALLOWED.keys() - names_of_its_own(source) == set()


def names_of_its_own(source: str) -> set[str]:
    """Names that a source defines, as attributes or functions."""
    stored = {
        n.attr
        for n in nodes(source)
        if isinstance(n, ast.Attribute) and isinstance(n.value, ast.Name) and n.value.id == "self"
    }
    return stored | {function.name for function in functions(source)}


@pytest.mark.parametrize(
    "source",
    [
        "METHODS._known",
        "from glossbench.methods.regular_sampling import _kernel",
        "monkeypatch.setattr(module, '_kernel', None)",
        "monkeypatch.setattr('glossbench.module._kernel', None)",
    ],
)
def test_a_private_name_is_noticed(source):
    assert private_names(source) - ALLOWED.keys()


# Tests that can fail.


@cache
def functions(source: str) -> list[ast.FunctionDef]:
    return [node for node in nodes(source) if isinstance(node, ast.FunctionDef)]


@cache
def calls(function: ast.FunctionDef) -> set[str]:
    """Last names of what a function calls."""
    return {last_name(n.func) for n in ast.walk(function) if isinstance(n, ast.Call)}


def asserts(function: ast.FunctionDef) -> bool:
    """Whether a function asserts anything itself: a literal is not anything."""
    statements = [n for n in ast.walk(function) if isinstance(n, ast.Assert)]
    by_name = calls(function) & {"raises", "fail", "assert_close", "assert_allclose", "assert_array_equal"}
    return bool(by_name) or any(not isinstance(n.test, ast.Constant) for n in statements)


def without_assertion(sources: dict[Path, str]) -> list[str]:
    """Tests that neither assert nor call a function of the tests that does, at any depth."""
    known = defaultdict(list)
    for source in sources.values():
        for function in functions(source):
            known[function.name].append(function)
    good = {name for name, bodies in known.items() if any(map(asserts, bodies))}
    while more := {name for name, bodies in known.items() if name not in good and any(calls(b) & good for b in bodies)}:
        good |= more
    return [
        f"{path}: {function.name}"
        for path, source in sources.items()
        for function in functions(source)
        if function.name.startswith("test_") and not asserts(function) and not calls(function) & good
    ]


def test_every_test_asserts_something():
    assert without_assertion(SOURCES) == []


@pytest.mark.parametrize(
    "source",
    [
        "def test_a():\n    make()",
        "def test_a():\n    assert True",
        "def test_a():\n    for e in entries():\n        create(e)",
        "def create(e):\n    return e\n\ndef test_a():\n    create(1)",
    ],
)
def test_a_test_that_asserts_nothing_is_noticed(source):
    assert without_assertion({Path("test_a.py"): source}) == ["test_a.py: test_a"]


def test_a_check_that_another_function_makes_counts():
    source = "def check(x):\n    assert x\n\ndef outer(x):\n    check(x)\n\ndef test_a():\n    outer(1)"

    assert without_assertion({Path("test_a.py"): source}) == []


# The fast tier.


LISTED = [line for line in (TESTS / "slow.txt").read_text().splitlines() if line and line[0] != "#"]


@cache
def every_test() -> set[str]:
    return {
        f"{path.as_posix()}::{function.name}"
        for path, source in SOURCES.items()
        for function in functions(source)
        if function.name.startswith("test_")
    }


def unknown(listed: list[str]) -> list[str]:
    """Lines that name neither a file of tests nor a test."""
    return sorted(set(listed) - every_test() - {name.partition("::")[0] for name in every_test()})


def test_what_is_left_out_of_the_fast_tier_exists():
    assert unknown(LISTED) == []


def test_a_line_that_names_no_test_is_noticed():
    gone = ["envmap/test_gone.py", "test_tests.py::test_gone"]

    assert unknown([*gone, "test_tests.py", "test_tests.py::test_no_file_imports_a_test"]) == gone


def rooms_left_out(listed: list[str]) -> set[str]:
    """Folders of tests that have none in the fast tier."""
    fast = {name for name in every_test() if name not in listed and name.partition("::")[0] not in listed}
    return {str(Path(name).parent) for name in every_test()} - {str(Path(name).parent) for name in fast}


def test_the_fast_tier_has_tests_of_every_room():
    assert rooms_left_out(LISTED) == set()


def test_a_room_that_is_left_out_is_noticed():
    assert rooms_left_out([name for name in every_test() if name.startswith("truth/")]) == {"truth"}
