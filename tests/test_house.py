"""The house: which room may import which, and what a room must have."""

import ast
import sys
import tomllib
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
# Where each folder is found once installed.
PACKAGES = {"glossbench": "glossbench", "methods": "glossbench.methods", "reports": "glossbench.reports"}
# From the ground up: a room imports itself and the rooms before it. The loose files of glossbench are the ground.
ROOMS = (
    "ground", "catalog", "process", "envmap", "brdf", "scene", "metrics", "shading", "truth", "prefilter", "study",
    "findings", "run", "contract", "commands", "door",
)  # fmt: skip
DOORS = ("glossbench", "glossbench.__main__")  # what Python and the shell enter by
FACADE = "glossbench.prefilter"
MOST_MODULES = 5  # that a method imports, besides Python's own: the façade and four libraries


@cache
def imports(source, package):
    """Names of all modules that a module of this package may import, at any depth of its code.

    `from a import b` counts as a and as a.b, for b may be a module; a relative import is resolved; a literal
    name handed to import_module counts too.
    """
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {(alias.name,) for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            found |= {(module, f"{module}.{alias.name}") for alias in node.names}
        elif isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] in ("import_module", "__import__"):
            literal = [arg.value for arg in node.args if isinstance(arg, ast.Constant) and isinstance(arg.value, str)]
            found |= {(name,) for name in literal}
    return found


def within(name, package):
    return name == package or name.startswith(f"{package}.")


def modules():
    """(dotted name, package, path) of every file of the core, the methods and the reports."""
    for folder, package in PACKAGES.items():
        for path in sorted((ROOT / folder).rglob("*.py")):
            parts = path.relative_to(ROOT / folder).with_suffix("").parts
            inside = [package, *parts[:-1]]
            yield ".".join(inside if parts[-1] == "__init__" else [*inside, parts[-1]]), ".".join(inside), path


SOURCES = {name: (package, path.read_text(encoding="utf-8")) for name, package, path in modules()}


def room(module):
    """Of a module of the core."""
    if module in DOORS:
        return "door"
    part = module.split(".")[1]
    return part if part in ROOMS else "ground"


def side(module):
    return next((each for each in ("methods", "reports") if within(module, PACKAGES[each])), "glossbench")


def forbidden(module, package, source):
    """Imports of this module (its dotted name and package) that the house does not allow."""
    closed = {"glossbench": ("glossbench.methods", "glossbench.reports"),
              "methods": ("glossbench.methods", "glossbench.reports"),
              "reports": ("glossbench.methods",)}[side(module)]  # fmt: skip
    names = {name for each in imports(source, package) for name in each}
    # A method that is a folder may import its own files.
    home = package if side(module) == "methods" and package != PACKAGES["methods"] else module
    found = {n for n in names if any(within(n, p) for p in closed) and not within(n, home)}
    for each in imports(source, package):
        target = each[-1] if each[-1] in SOURCES else each[0]
        if target not in SOURCES or side(target) != "glossbench":
            continue
        if side(module) == "methods":
            allowed = each[0] == FACADE
        elif side(module) == "reports":
            allowed = ROOMS.index(room(target)) <= ROOMS.index("run")
        else:
            allowed = ROOMS.index(room(target)) <= ROOMS.index(room(module))
        if not allowed:
            found.add(target)
    return sorted(found)


@pytest.mark.parametrize("module", SOURCES)
def test_a_module_imports_only_what_its_room_allows(module):
    assert forbidden(module, *SOURCES[module]) == []


def test_the_walk_sees_every_room():
    names = SOURCES.keys()

    assert {room(name) for name in names if side(name) == "glossbench"} == set(ROOMS)
    assert {"glossbench", "glossbench.shading.method", "glossbench.envmap.cubemap"} <= names
    assert {"glossbench.methods.regular_sampling", "glossbench.reports.page.html"} <= names


METHOD, REPORT = "glossbench.methods.new_method", "glossbench.reports.print.pdf"
RUNNER, CUBEMAP = "glossbench.run.runner", "glossbench.envmap.cubemap"
FAULTS = [
    (RUNNER, "import glossbench.methods.regular_sampling"),
    (RUNNER, "from glossbench.methods import regular_sampling"),
    (RUNNER, "from glossbench.methods.regular_sampling import RegularSampling as R"),
    (RUNNER, "def run():\n    from glossbench import reports"),
    (RUNNER, "if True:\n    import glossbench.reports.page.html as html"),
    (RUNNER, "from ..methods import regular_sampling"),
    (RUNNER, "from .. import reports"),
    (RUNNER, 'importlib.import_module("glossbench.reports.page.html")'),
    (RUNNER, "from glossbench.commands.printing import count"),
    (RUNNER, "import glossbench"),
    (RUNNER, "from glossbench import shade"),
    (CUBEMAP, "from ..reports.page.html import write_report"),
    (CUBEMAP, "from glossbench.brdf.material import Material"),
    (CUBEMAP, "from glossbench.brdf import material"),
    (CUBEMAP, "import glossbench.shading.method"),
    (CUBEMAP, "if TYPE_CHECKING:\n    from glossbench.scene.points import View"),
    ("glossbench.registry", "from glossbench.process.state import is_foreign"),
    ("glossbench.truth.reference", "from glossbench.prefilter import pyramid"),
    (METHOD, "from glossbench.methods.importance_sampling import ImportanceSampling"),
    (METHOD, "from .importance_sampling import ImportanceSampling"),
    (METHOD, "from glossbench.reports import style"),
    (METHOD, "import glossbench.reports.page.html"),
    (METHOD, "from glossbench.envmap.pyramid import lookup"),
    (METHOD, "from glossbench import Method"),
    (METHOD, "from glossbench.prefilter.stages import pyramid"),
    (REPORT, "from glossbench.methods.importance_sampling import ImportanceSampling"),
    (REPORT, "from glossbench import methods"),
    (REPORT, "from ...methods import regular_sampling"),
    (REPORT, "from glossbench.commands.printing import count"),
]


@pytest.mark.parametrize(("module", "source"), FAULTS)
def test_the_walk_notices(module, source):
    assert forbidden(module, module.rpartition(".")[0], source)


ALLOWED = [
    (RUNNER, "from glossbench.shading.method import METHODS"),
    (RUNNER, "from glossbench.methods_of_study import cells"),
    (RUNNER, "from glossbench import provenance"),
    (RUNNER, 'home = "glossbench.methods"'),
    (CUBEMAP, "from glossbench.envmap.pyramid import lookup"),
    (METHOD, "from glossbench.prefilter import METHODS, lookup, stage\nimport torch"),
    ("glossbench.methods.folder.factors", "from .rows import rows"),
    ("glossbench.methods.folder.factors", "from glossbench.methods.folder import rows"),
    (REPORT, "from glossbench.run.results import Results"),
    (REPORT, "from glossbench.reports.style import tone_map"),
    (REPORT, "from ..style import tone_map"),
]


@pytest.mark.parametrize(("module", "source"), ALLOWED)
def test_the_walk_lets_the_other_arrows_pass(module, source):
    assert forbidden(module, module.rpartition(".")[0], source) == []


def circle(sources):
    """Modules that import each other in a circle, those for types too; empty where none do."""
    arrows = {}
    for module, (package, source) in sources.items():
        targets = {each[-1] if each[-1] in sources else each[0] for each in imports(source, package)}
        arrows[module] = (targets & sources.keys()) - {module}
    try:
        TopologicalSorter(arrows).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def test_no_modules_import_each_other_in_a_circle():
    assert circle(SOURCES) == []


@pytest.mark.parametrize(
    "source",
    ["from glossbench.envmap.pyramid import lookup", "if TYPE_CHECKING:\n    import glossbench.envmap.pyramid"],
)
def test_a_circle_is_noticed(source):
    package, text = SOURCES[CUBEMAP]

    assert set(circle(SOURCES | {CUBEMAP: (package, f"{text}\n{source}")})) == {CUBEMAP, "glossbench.envmap.pyramid"}


def libraries(source, package):
    """The modules that a method imports, without Python's own and the method's files."""
    names = {each[0] for each in imports(source, package)}
    return {n for n in names if n.partition(".")[0] not in sys.stdlib_module_names and side(n) != "methods"}


@pytest.mark.parametrize("module", [name for name in SOURCES if side(name) == "methods"])
def test_a_method_imports_few_modules(module):
    package, source = SOURCES[module]

    assert len(libraries(source, package)) <= MOST_MODULES


def test_many_modules_of_a_method_are_noticed():
    source = "import math, torch, numpy, scipy.linalg, pandas, PIL\nfrom glossbench.prefilter import stage"

    assert len(libraries(source, "glossbench.methods")) == 6 > MOST_MODULES


def test_the_façade_hands_on_what_it_says_and_nothing_twice():
    tree = ast.parse(SOURCES[FACADE][1])
    imported = [alias.name for node in tree.body if isinstance(node, ast.ImportFrom) for alias in node.names]
    [listed] = [ast.literal_eval(node.value) for node in tree.body if isinstance(node, ast.Assign)]

    assert sorted(listed) == sorted(imported)
    assert len(set(listed)) == len(listed)


def unlisted(listed, folders):
    """Package folders that a wheel would leave out."""
    return sorted(folders - set(listed))


FOLDERS = {package for package, _ in SOURCES.values()}
LISTED = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]["packages"]


def test_every_folder_is_a_package_of_the_wheel():
    assert unlisted(LISTED, FOLDERS) == []
    assert unlisted(FOLDERS | {"glossbench.studies", "glossbench.data"}, set(LISTED)) == []


def test_a_folder_that_is_not_listed_is_noticed():
    assert unlisted(set(LISTED) - {"glossbench.scene"}, FOLDERS) == ["glossbench.scene"]


@pytest.mark.parametrize("folder", sorted(FOLDERS))
def test_every_folder_says_what_it_is(folder):
    package, source = SOURCES[folder]

    assert package == folder
    assert ast.get_docstring(ast.parse(source))
