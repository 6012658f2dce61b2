"""The table of columns: units, roles, and what `columns.json` keeps of it."""

import json
from dataclasses import replace

import pytest

from glossbench.columns import COLUMNS, CellRecord, Column, parse_row
from glossbench.errors import InputError
from glossbench.findings.columns import collect_columns, columns_from_json, columns_to_json, make_metric_column


def test_shading_time_is_shown_in_milliseconds():
    column = COLUMNS["shade_seconds"]
    assert (column.heading, column.scale, column.role) == ("shading time [ms]", 1e3, "cost")


def test_one_number_of_a_dict_has_a_separate_column():
    part = COLUMNS["update_seconds"].part("light")
    assert (part.name, part.type, part.unit) == ("update_seconds.light", float, "ms")


def test_options_are_json_and_times_are_not():
    assert [name for name, column in COLUMNS.items() if column.is_json] == [
        "light_options", "material_options", "view_options", "options", "tuned", "tune", "notes", "left_out",
        "stage_seconds", "update_seconds",
    ]  # fmt: skip


def test_a_metric_brings_unit_direction_and_sign():
    column = make_metric_column("mean_error")
    assert (column.unit, column.lower_is_better, column.signed, column.role) == ("radiance", True, True, "error")
    assert not make_metric_column("ssim").lower_is_better


def test_a_metric_without_unit_has_an_empty_one():
    assert make_metric_column("flip").unit == ""


def test_a_metric_that_is_not_installed_is_known_by_name():
    assert make_metric_column("of_a_plugin") == Column("of_a_plugin", float, role="error", title="of_a_plugin")


def test_the_rms_error_is_always_a_column():
    assert "rms" in collect_columns([])


def test_columns_come_back_from_json_as_they_were():
    columns = collect_columns(["flip", "mean_error"])
    assert columns_from_json(json.loads(json.dumps(columns_to_json(columns)))) == columns


def test_what_another_version_states_of_a_column_is_left_out():
    stated = [{"name": "x", "type": "float", "unit": "s", "colour": "red"}]
    assert columns_from_json(stated) == {"x": Column("x", float, "s")}


@pytest.mark.parametrize("stated", [None, 3, ["x"], [{"name": "x"}], [{"name": "x", "type": "tensor"}]])
def test_what_is_not_a_table_of_columns_is_refused(stated):
    with pytest.raises(InputError, match=r"columns\.json does not hold a table of columns"):
        columns_from_json(stated)


RECORD = CellRecord(key="k", reference_key="r", light="constant", material="ggx", view="sphere", method="many_lights")


def test_a_row_has_every_declared_column_and_its_metrics():
    record = replace(RECORD, metrics={"flip": 0.25})
    assert set(record.to_row()) == {name for name in COLUMNS if not name.endswith("_name")} | {"flip"}
    assert record.to_row()["flip"] == 0.25


def test_options_in_another_order_are_the_same_text():
    first, second = (
        replace(RECORD, options=options).to_row()["options"] for options in ({"a": 1, "b": 2}, {"b": 2, "a": 1})
    )
    assert first == second == '{"a": 1, "b": 2}'


def test_stages_keep_their_order_in_a_row():
    row = replace(RECORD, stage_seconds={"z": 1.0, "a": 2.0}).to_row()
    assert list(parse_row(row)["stage_seconds"]) == ["z", "a"]


def test_a_parsed_row_has_the_values_of_its_record_and_none_for_what_is_missing():
    record = replace(RECORD, options={"samples": 4}, notes=["a note"], shade_seconds=0.5)
    row = parse_row(record.to_row())
    assert (row["options"], row["notes"], row["shade_seconds"]) == ({"samples": 4}, ["a note"], 0.5)
    assert row["reference_noise"] is None


def test_a_record_takes_no_column_that_is_not_declared():
    with pytest.raises(TypeError, match="shade_secnods"):
        replace(RECORD, shade_secnods=1.0)
