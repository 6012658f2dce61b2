"""`glossbench compare`: its exit codes, what it prints, and what counts as a result."""

import json
from pathlib import Path

import pandas
import pytest

from glossbench.findings.columns import collect_columns, columns_to_json
from glossbench.findings.summary import Summary
from glossbench.run.results import Results
from oracles.command_line import words

pytestmark = pytest.mark.usefixtures("here")


def publish(name, results, *kept, **changes):
    """The table of results as a .parquet beside its columns.json, with some rows alone, and with changed columns."""
    cells = pandas.read_parquet(results / "cells.parquet")
    cells = cells.iloc[list(kept)] if kept else cells
    Path(name).mkdir()
    cells.assign(**changes).to_parquet(f"{name}/cells.parquet")
    Path(name, "columns.json").write_text(json.dumps(columns_to_json(collect_columns(["rms", "mean_error"]))))
    return f"{name}/cells.parquet"


def lines(out):
    """What the summary says, by its first word."""
    return dict(line.split(maxsplit=1) for line in out.split("\n\n")[0].splitlines())


def test_results_are_not_worse_than_themselves(call, results):
    code, out, _ = call("compare", results, results)

    said = lines(out)
    assert code == 0
    assert said["result"] == "nothing is worse beyond noise"
    assert said["cells"] == "2 in both, 0 only in A, 0 only in B"
    assert said["errors"].startswith("0 worse, 0 better, 0 within noise, 8 equal within 1 % (rms, ")
    assert said["noise"] == "8 errors have the same references in both, whose noise cancels"


def test_a_planted_error_is_listed_and_ends_with_1(call, results):
    cells = pandas.read_parquet(results / "cells.parquet")
    scaled = [json.loads(text) for text in cells["left_out"]]
    scaled[1]["rms"] = [1.1 * value for value in scaled[1]["rms"]]
    worse = publish("worse", results, rms=cells["rms"] * [1, 1.1], left_out=list(map(json.dumps, scaled)))

    code, out, _ = call("compare", results, worse)
    back, returned, _ = call("compare", worse, results)

    assert (code, back) == (1, 0)
    assert lines(out)["result"] == "1 errors are worse"
    head, *rows = out.split("\n\n")[1].splitlines()
    assert head.split() == ["method", "worse", "A", "B", "B", "/", "A", "95", "%", "interval"]
    assert [(line.split()[:4], line.split()[6]) for line in rows] == [
        (["importance_sampling", "(samples", "8)", "rms"], "1.1")
    ]
    assert lines(returned)["errors"].startswith("0 worse, 1 better")


def test_a_longer_time_alone_ends_with_3(call, results):
    calm = publish("calm", results, busy=0.0)
    columns = ("shade_seconds", "shade_seconds_low", "shade_seconds_high")
    cells = pandas.read_parquet(calm)
    slow = publish("slow", results, busy=0.0, **{name: 100 * cells[name] for name in columns})

    assert call("compare", calm, slow).code == 3
    assert lines(call("compare", slow, calm).out)["times"] == "0 slower, 2 faster, of 2 compared"


def test_times_of_different_processors_are_not_compared(call, results):
    code, out, _ = call("compare", results, publish("other", results, processor="another"))

    here = pandas.read_parquet(results / "cells.parquet")["processor"][0]
    assert code == 0
    assert lines(out)["times"] == f"2 cells not compared: different processors: {here} and another"


def test_a_cell_that_failed_ends_with_1_and_its_reason(call, results):
    failed = publish("failed", results, status=["done", "failed"], reason=["", "Traceback\nValueError: planted"])

    code, out, _ = call("compare", results, failed)

    assert code == 1
    assert lines(out)["result"] == "1 cells are not done any more"
    assert "(samples 8)  failed: ValueError: planted" in out


def test_cells_that_only_one_result_has_are_listed_and_do_not_count(call, results):
    code, out, _ = call("compare", results, publish("part", results, 0))

    assert code == 0
    assert lines(out)["cells"] == "1 in both, 1 only in A, 0 only in B"
    assert words(out).endswith("method only in A importance_sampling (samples 8)")


def test_a_published_summary_counts_with_its_columns(call, results):
    opened = Results.open(results)
    Summary("kept", opened.study, [], opened.provenance, opened.cells, opened.columns).write(Path("kept"))

    assert Summary.read(Path("kept")).columns == opened.columns
    assert call("compare", "kept", results).code == 0
    assert call("compare", results, f"file://{Path('kept').resolve()}").code == 0
    assert call("compare", results, "kept/cells.parquet").code == 0


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"method": "another"}, "each method differs, importance_sampling and another"),
        ({"light": "spots"}, "each light differs, gradient and spots"),
        ({"material_options": "{\"alpha\": 0.1}"},
         "the options or the combinations of their lights, materials, views and methods differ"),
    ],
)  # fmt: skip
def test_results_without_a_common_cell_are_bad_input(call, results, changes, why):
    code, out, err = call("compare", results, publish("other", results, **changes))

    assert (code, out) == (2, "")
    assert err == f"error: {results} and other/cells.parquet have no cell in common: {why}\n"


def test_what_is_not_a_result_is_one_line(call, results):
    publish("alone", results)
    Path("alone/columns.json").unlink()
    Path("text.parquet").write_text("no")
    pandas.DataFrame({"a": [1]}).to_parquet("b.parquet")
    Path("columns.json").write_text("[]")

    wrong = {
        "none": "none holds no results: cells.parquet is missing",
        "none.parquet": "there is no file none.parquet",
        "alone/cells.parquet": "alone/cells.parquet: columns.json, which says what its columns mean, is missing "
        "beside it",
        "text.parquet": "text.parquet is damaged, or not a table",
        "b.parquet": "b.parquet is not a table of cells: the column light is missing",
    }
    assert {name: call("compare", results, name)[::2] for name in wrong} == {
        name: (2, f"error: {line}\n") for name, line in wrong.items()
    }


def test_the_help_states_the_exit_codes(call):
    said = words(call("compare", "--help").out)

    assert "1 an error is worse, or a cell is not done any more; 3 only a shading time is longer; 2 bad input" in said
