"""Public files on the command line: listed, fetched."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import pytest

from glossbench.catalog import entries as catalog
from glossbench.catalog.entries import Entry, list_entries
from oracles.command_line import words

pytestmark = pytest.mark.usefixtures("here")


def test_data_list_says_what_is_here(call, here, monkeypatch):
    content = b"v 0 0 0\n"
    stated = Entry("dot", "mesh", "dot.obj", "http://127.0.0.1:9/dot.obj", hashlib.sha256(content).hexdigest(),
                   len(content), "CC0", "one point")  # fmt: skip
    gone = Entry("gone", "mesh", "gone.obj", "http://127.0.0.1:9/gone.obj", "0" * 64, 2_400_000, "CC0", "no point")
    monkeypatch.setattr("glossbench.commands.data.list_entries", lambda kind=None: [stated, gone])
    monkeypatch.setenv("GLOSSBENCH_DATA", str(here))
    (here / "dot.obj").write_bytes(content)

    table, listed = call("data", "list"), call("data", "list", "--json")

    lines = [words(line) for line in table.out.splitlines()]
    assert lines[1:3] == ["dot mesh 0.00 yes one point", "gone mesh 2.40 no no point"]
    assert f"here: {here}" in lines
    assert [one["local"] for one in json.loads(listed.out)] == [str(here / "dot.obj"), None]
    assert json.loads(listed.out)[0]["licence"] == "CC0"


def test_data_fetch_prints_where_each_file_is(call, monkeypatch):
    asked = []
    monkeypatch.setattr("glossbench.commands.data.fetch", lambda name, progress: asked.append(name) or Path(name))

    named = call("data", "fetch", "teapot", "spot", "teapot")
    of_a_kind = call("data", "fetch", "--kind", "mesh")
    everything_there_is = call("data", "fetch", "--all")

    assert named.out == "teapot\nspot\n"
    assert set(of_a_kind.out.split()) == {e.name for e in list_entries("mesh")}
    assert everything_there_is.out.split() == [e.name for e in list_entries()]
    assert len(asked) == 2 + len(list_entries("mesh")) + len(list_entries())


def test_data_fetch_without_a_network_is_one_line(call, monkeypatch):
    unreachable = replace(catalog.find_entry("teapot"), url="http://127.0.0.1:9/teapot.obj")
    monkeypatch.setattr(catalog, "list_entries", lambda kind=None: [unreachable])
    monkeypatch.setattr("glossbench.commands.data.find_entry", lambda name: unreachable)
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")

    code, out, err = call("data", "fetch", "teapot")

    assert (code, out) == (2, "")
    told, error = err.splitlines()
    assert told == "teapot.obj is not here: fetching 0.2 MB from 127.0.0.1:9"
    assert error.startswith("error: cannot reach 127.0.0.1:9: Connection refused; the file may be put into ")
