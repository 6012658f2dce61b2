"""docs/reference is what the registries say."""

from pathlib import Path

import pytest

from glossbench.commands.reference_pages import write_pages
from glossbench.options import list_options
from glossbench.study.registries import REGISTRIES

COMMITTED = Path(__file__).parents[2] / "docs" / "reference"


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """By name the text of each page, written now."""
    folder = tmp_path_factory.mktemp("reference")
    return {path.name: path.read_text(encoding="utf-8") for path in write_pages(folder, REGISTRIES)}


def test_the_committed_pages_are_those_that_the_registries_give(pages):
    committed = {path.name: path.read_text(encoding="utf-8") for path in COMMITTED.iterdir()}

    assert committed == pages, "make reference writes them"


@pytest.mark.parametrize("kind", sorted(REGISTRIES))
def test_each_option_of_each_class_has_a_row_with_its_meaning(pages, kind):
    registry = REGISTRIES[kind]
    without = []
    for section in pages[f"{kind}s.md"].split("\n## ")[1:]:
        name = section.split()[0]
        rows = {row.split("|")[1].strip(" `"): row for row in section.splitlines() if row.startswith("| `")}
        assert set(rows) == set(list_options(registry.get(name)))
        without += [f"{name}.{option}" for option, row in rows.items() if row.endswith("|  |")]

    assert not without
