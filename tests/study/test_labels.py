"""Names of rows: they distinguish inputs, and tuned options from stated ones."""

import json

import pytest

from glossbench.study import labels as rows_module
from glossbench.study.labels import distinguish_rows, identify, name_items, parse_row, read_budget, with_names


def row(**changes):
    """A row of a run as on disk; options are given as dictionaries."""
    plain = {
        "method": "few", "options": {"samples": 4}, "tuned": {}, "status": "done", "n_samples": 4,
        "light": "spots", "light_options": {}, "material": "kurt", "material_options": {},
        "view": "sphere", "view_options": {},
    } | changes  # fmt: skip
    return {key: json.dumps(value) if isinstance(value, dict) else value for key, value in plain.items()}


def names(kind, name, *options):
    """Names of lights, materials or views of one name and these options, in order."""
    given = [parse_row(row(**{kind: name, f"{kind}_options": each})) for each in options]
    found = name_items(kind, given)
    return [found[identify(kind, each)] for each in given]


def told(*given, over=None):
    return [line for _, line in distinguish_rows([parse_row(each) for each in given], over)]


def biased(bias, tune=None, **changes):
    how = {"mip_bias": tune} if tune else {}
    tuned = {"mip_bias": bias} if tune else {}
    return row(options={"samples": 4, "mip_bias": bias}, tuned=tuned, tune=how, **changes)


RMS = {"tune": "rms", "range": [-2, 2]}


def test_names_of_files_have_as_much_of_their_paths_as_distinguishes_them():
    paths = ("/a/1k/probe.exr", "/b/1k/probe.exr", "/b/1k/grace.exr", "sky.hdr", "c\\2k\\probe.exr")

    found = names("light", "file", *({"file": path} for path in paths))

    assert found == ["a/1k/probe.exr", "b/1k/probe.exr", "grace.exr", "sky.hdr", "2k/probe.exr"]


def test_a_single_file_has_its_name_and_a_measured_material_says_what_it_is():
    assert names("light", "file", {"file": "/a/probe.exr"}) == ["probe.exr"]
    assert names("material", "measured", {"file": "x/garnet.brdf", "lobes": 2}) == ["measured garnet.brdf"]
    two = names("material", "measured", {"file": "x/garnet.brdf"}, {"file": "y/garnet.brdf"})
    assert two == ["measured x/garnet.brdf", "measured y/garnet.brdf"]


def test_one_file_with_two_options_is_distinguished_by_them():
    found = names("light", "file", {"file": "/a/p.exr", "rotation": 0.0}, {"file": "/a/p.exr", "rotation": 90.0})

    assert found == ["p.exr (rotation 0)", "p.exr (rotation 90)"]


def test_an_option_that_is_a_path_is_shortened_as_well():
    assert names("view", "mesh", {"shape": "/m/a/cup.obj"}, {"shape": "/m/b/cup.obj"}, {"shape": "knot"}) == [
        "mesh (shape a/cup.obj)", "mesh (shape b/cup.obj)", "mesh (shape knot)",
    ]  # fmt: skip


def test_numbers_have_as_many_digits_as_distinguish_them():
    assert names("material", "ggx", {"alpha": 0.12}, {"alpha": 0.3}) == ["ggx (alpha 0.12)", "ggx (alpha 0.3)"]
    assert names("material", "ggx", {"alpha": 0.123456}, {"alpha": 0.123457}) == [
        "ggx (alpha 0.123456)", "ggx (alpha 0.123457)",
    ]  # fmt: skip


def test_different_inputs_never_have_one_name():
    options = [{"file": "p.exr"}, {"file": "./p.exr"}, {"x": "1"}, {"x": 1}, {"file": "a/p.exr"}, {"file": "a//p.exr"}]

    assert len(set(names("light", "file", *options))) == len(options)


def test_the_table_says_what_its_inputs_are_called():
    table = with_names([row(light="file", light_options={"file": f"/{at}/probe.exr"}) for at in "ab"])

    assert [each["light_name"] for each in table] == ["a/probe.exr", "b/probe.exr"]
    assert (table[0]["material_name"], table[0]["view_name"]) == ("kurt", "sphere")


def test_a_tuned_option_is_distinguished_from_a_stated_one():
    check_tuned(told(biased(0.0), biased(1.0), biased(0.37, RMS)))


def test_the_check_of_tuned_options_notices_the_value_that_came_out(monkeypatch):
    monkeypatch.setattr(rows_module, "read_stated", lambda row: row["options"])

    with pytest.raises(AssertionError):
        check_tuned(told(biased(0.0), biased(1.0), biased(0.0, RMS)))


def check_tuned(found):
    assert found == [{"mip_bias": "0"}, {"mip_bias": "1"}, {"mip_bias": "tuned by rms"}]


def test_over_the_option_itself_only_the_tuned_line_names_it():
    assert told(biased(0.0), biased(1.0), biased(0.37, RMS), over="mip_bias") == [
        {}, {}, {"mip_bias": "tuned by rms"},
    ]  # fmt: skip


def test_two_ways_to_tune_are_distinguished_and_one_way_is_not_shown():
    flip, narrow = RMS | {"tune": "flip"}, RMS | {"range": [0, 1]}

    assert told(biased(0.1, RMS), biased(0.2, RMS)) == [{}, {}]
    assert [each["mip_bias"] for each in told(biased(0.1, RMS), biased(0.1, flip))] == ["tuned by rms", "tuned by flip"]
    assert [each["mip_bias"] for each in told(biased(0.1, RMS), biased(0.1, narrow))] == [
        "tuned by rms in [-2, 2]", "tuned by rms in [0, 1]",
    ]  # fmt: skip


def test_an_option_that_is_null_is_left_out():
    chosen = [row(options={"samples": 4, "lobe": lobe, "weight": weight}) for lobe, weight in
              ((None, None), ("sg", None), (None, "cos"))]  # fmt: skip

    assert told(*chosen) == [{}, {"lobe": "sg"}, {"weight": "cos"}]


def test_a_failed_cell_of_a_tuned_method_does_not_pass_for_a_stated_one():
    failed = biased(-2.0, RMS, status="failed", n_samples=0) | {"tuned": "{}"}

    assert told(biased(-2.0), failed) == [{"mip_bias": "−2"}, {"mip_bias": "tuned by rms"}]


def test_results_that_do_not_say_how_they_were_tuned_say_that_they_were():
    old = biased(0.37, RMS)
    del old["tune"]

    assert told(biased(0.0), old)[1] == {"mip_bias": "tuned"}


def test_the_budget_is_the_option_that_the_row_says():
    rays = [row(options={"samples": s, "rays": n}, budget="rays") for s in (1, 2) for n in (4, 8)]

    assert [read_budget(parse_row(each)) for each in rays] == [4, 8, 4, 8]
    assert told(*rays) == [{"samples": "1"}, {"samples": "1"}, {"samples": "2"}, {"samples": "2"}]
    assert read_budget(parse_row(row())) == 4  # of results whose rows do not say
    assert read_budget(parse_row(row(budget=""))) is None
