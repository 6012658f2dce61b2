"""The house: methods -> glossbench <- reports, and no other arrow."""

import ast
from pathlib import Path

import pytest

from glossbench.provenance import NUMERICS

ROOT = Path(__file__).resolve().parents[1]
# Where each folder is found once installed.
PACKAGES = {"glossbench": "glossbench", "methods": "glossbench.methods", "reports": "glossbench.reports"}


def imports(source, package):
    """Names of all modules that a module of this package may import, at any depth of its code.

    `from a import b` counts as a and as a.b, for b may be a module; a relative import is resolved; a literal
    name handed to import_module counts too.
    """
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            found |= {module} | {f"{module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] in (
            "import_module",
            "__import__",
        ):
            found |= {arg.value for arg in node.args if isinstance(arg, ast.Constant) and isinstance(arg.value, str)}
    return found


def within(name, package):
    return name == package or name.startswith(f"{package}.")


def forbidden(module, package, source):
    """Imports of this module (its dotted name and package) that the house does not allow."""
    closed = {"glossbench": ("glossbench.methods", "glossbench.reports"),
              "methods": ("glossbench.methods", "glossbench.reports"),
              "reports": ("glossbench.methods",)}  # fmt: skip
    folder = next((f for f in ("methods", "reports") if within(module, PACKAGES[f])), "glossbench")
    names = imports(source, package)
    # A method that is a folder may import its own files.
    home = package if folder == "methods" and package != PACKAGES["methods"] else module
    return sorted(n for n in names if any(within(n, p) for p in closed[folder]) and not within(n, home))


def modules():
    """(dotted name, package, path) of every file of the core, the methods and the reports."""
    for folder, package in PACKAGES.items():
        for path in sorted((ROOT / folder).rglob("*.py")):
            parts = path.relative_to(ROOT / folder).with_suffix("").parts
            inside = [package, *parts[:-1]]
            name = ".".join(inside if parts[-1] == "__init__" else [*inside, parts[-1]])
            yield pytest.param(name, ".".join(inside), path, id=name)


@pytest.mark.parametrize(("module", "package", "path"), list(modules()))
def test_a_module_imports_only_what_its_room_allows(module, package, path):
    assert forbidden(module, package, path.read_text()) == []


def test_the_walk_sees_every_room():
    names = {parameters.values[0] for parameters in modules()}

    assert {"glossbench", "glossbench.shading.method", "glossbench.envmap.cubemap"} <= names
    assert {"glossbench.methods.regular_sampling", "glossbench.reports.page.html"} <= names


METHOD, REPORT = "glossbench.methods.new_method", "glossbench.reports.print.pdf"
FAULTS = [
    ("glossbench.run.runner", "import glossbench.methods.regular_sampling"),
    ("glossbench.run.runner", "from glossbench.methods import regular_sampling"),
    ("glossbench.run.runner", "from glossbench.methods.regular_sampling import RegularSampling as R"),
    ("glossbench.run.runner", "def run():\n    from glossbench import reports"),
    ("glossbench.run.runner", "if True:\n    import glossbench.reports.page.html as html"),
    ("glossbench.run.runner", "from ..methods import regular_sampling"),
    ("glossbench.run.runner", "from .. import reports"),
    ("glossbench.envmap.cubemap", "from ..reports.page.html import write_report"),
    ("glossbench.run.runner", 'importlib.import_module("glossbench.reports.page.html")'),
    (METHOD, "from glossbench.methods.importance_sampling import ImportanceSampling"),
    (METHOD, "from .importance_sampling import ImportanceSampling"),
    (METHOD, "from glossbench.reports import style"),
    (METHOD, "import glossbench.reports.page.html"),
    (REPORT, "from glossbench.methods.importance_sampling import ImportanceSampling"),
    (REPORT, "from glossbench import methods"),
    (REPORT, "from ...methods import regular_sampling"),
]


@pytest.mark.parametrize(("module", "source"), FAULTS)
def test_the_walk_notices(module, source):
    assert forbidden(module, module.rpartition(".")[0], source)


ALLOWED = [
    ("glossbench.run.runner", "from glossbench.shading.method import METHODS"),
    ("glossbench.run.runner", "from glossbench.methods_of_study import cells"),
    ("glossbench.run.runner", 'home = "glossbench.methods"'),
    (METHOD, "from glossbench.envmap.pyramid import lookup\nimport torch"),
    (METHOD, "from ..shading import METHODS"),
    (REPORT, "from glossbench.run.results import Results"),
    (REPORT, "from glossbench.reports.style import tone_map"),
    (REPORT, "from ..style import tone_map"),
]


@pytest.mark.parametrize(("module", "source"), ALLOWED)
def test_the_walk_lets_the_other_arrows_pass(module, source):
    assert forbidden(module, module.rpartition(".")[0], source) == []


# Imported by what computes, and of no weight for its numbers: files, messages, names, clocks.
NO_NUMBERS = {
    "atomic", "catalog", "checkpoint", "claims", "costs", "digests", "documentation", "download", "errors",
    "file_bytes", "import_closure", "items", "memory", "process",
    "provenance", "registry", "rules", "run", "srgb", "study", "unchanged",
}  # fmt: skip


def uncounted(parts):
    """Modules of the core that images or metrics are computed with, and that these parts leave out."""
    known = {p.values[0]: p.values for p in modules()}
    waiting = [name for name in known if within(name, "glossbench.methods") or within(name, "glossbench.metrics")]
    waiting += ["glossbench.truth.reference", "glossbench.run.measuring"]
    seen = set()
    while waiting:
        name = waiting.pop()
        if name in known and name not in seen and name != "glossbench":  # the package's own names are for callers
            seen.add(name)
            _, package, path = known[name]
            waiting += imports(path.read_text(), package)
    tops = {name.split(".")[1] for name in seen if not within(name, "glossbench.methods")}
    return sorted(tops - NO_NUMBERS - {part.removesuffix(".py") for part in parts})


def test_all_that_computes_decides_whether_a_cell_is_made_anew():
    assert uncounted(NUMERICS) == []


def test_the_check_of_what_computes_notices_a_module_left_out():
    assert uncounted(set(NUMERICS) - {"factorization.py", "envmap"}) == ["envmap", "factorization"]
