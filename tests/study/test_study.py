"""Studies: what a YAML file means, and one clear line for each thing that can be wrong in it."""

import dataclasses
import json
import math
import re
import sys
from contextlib import ExitStack
from importlib import resources
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
import yaml
from pydantic import Field

from glossbench.brdf.material import MATERIALS, Material
from glossbench.envmap.lights.file_light import FileLight
from glossbench.envmap.lights.light import LIGHTS, Light
from glossbench.errors import InputError
from glossbench.options import Color, Fraction, Resolution, Widths
from glossbench.scene.points import VIEWS, View
from glossbench.shading.method import METHODS, Method
from glossbench.study import document as yaml_marks
from glossbench.study.cells import Tuning, to_text
from glossbench.study.document import dump
from glossbench.study.schema import schema
from glossbench.study.study import load_study
from glossbench.study.study_files import find_study_files


class Glow(Light):
    """A light of the tests."""

    name = "glow"
    seed: int = 0
    resolution: Resolution = 16


@dataclasses.dataclass(frozen=True)
class Coat:
    """An option that has parts."""

    weight: float


class Plain(Material):
    """A material of the tests."""

    name = "plain"
    m: Widths = (0.5, 0.5)
    tint: Color = (1.0, 1.0, 1.0)
    f0: Fraction = 1.0
    coats: tuple[Coat, ...] = ()


class Round(View):
    """A view of the tests."""

    name = "round"
    resolution: Annotated[int, Field(ge=1)] = 8


class Sampler(Method):
    """A method of the tests."""

    name = "sampler"
    samples: Annotated[int, Field(ge=1)] = 40
    bias: Annotated[float, Field(ge=-2, le=2)] = 0.0
    gain: float = 1.0
    mip_filter: Literal["box", "gauss6"] = "box"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.samples > 1000 and self.mip_filter == "box":
            raise InputError("sampler: more than 1000 samples need gauss6")


class Needy(Method):
    """A method with an option that must be given."""

    name = "needy"
    width: Annotated[float, Field(ge=1, le=3)]


class Drawn(Method):
    """A method with a seed."""

    name = "drawn"
    samples: int = 1
    seed: Annotated[int, Field(le=100)] = 0


@pytest.fixture(autouse=True)
def names():
    """The registries hold the classes above, and nothing that other code registers."""
    kinds = [
        (LIGHTS, [Glow, FileLight]),
        (MATERIALS, [Plain]),
        (VIEWS, [Round]),
        (METHODS, [Sampler, Needy, Drawn]),
    ]
    with ExitStack() as stack:
        for registry, classes in kinds:
            stack.enter_context(registry.isolated(only=classes))
        yield


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Writes my.yaml into the current folder, and gives its name."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("GLOSSBENCH_DATA", raising=False)

    def to_file(text: str | bytes) -> str:
        Path("my.yaml").write_bytes(text.encode() if isinstance(text, str) else text)
        return "my.yaml"

    return to_file


def a_study(**changes: Any) -> str:
    """A small study in which some keys are replaced; one key a line, in flow style."""
    keys = {
        "title": "T",
        "light": "glow",
        "material": "plain",
        "view": "round",
        "methods": "sampler",
    } | changes
    return "".join(f"{key}: {value}\n" for key, value in keys.items() if value is not None)


def options_of(items, *names):
    return [tuple(item.as_dict()[name] for name in names) for item in items]


# What a study means


def test_defaults_are_spelled_out(write):
    study = load_study(write(a_study()))

    assert study.title == "T"
    assert study.name == "my"
    assert study.lights[0].as_dict() == {"seed": 0, "resolution": 16}
    assert study.methods[0].method.as_dict() == {"samples": 40, "bias": 0.0, "gain": 1.0, "mip_filter": "box"}
    assert study.metric_columns == ["rms", "relative_rms", "mean_error", "max_error"]
    assert study.reference.relative_error == 1e-3
    assert (study.seed, study.device, study.exclude, study.claims) == (0, "cpu", (), ())


def test_null_options_are_the_defaults(write):
    plain, null = (load_study(write(a_study(methods=text))) for text in ("sampler", "{sampler: }"))

    assert plain == null


def test_lists_multiply_out_in_source_order(write):
    study = load_study(write(a_study(methods="{sampler: {mip_filter: [box, gauss6], samples: [3, 2]}}")))

    expected = [("box", 3), ("box", 2), ("gauss6", 3), ("gauss6", 2)]
    assert options_of(study.methods, "mip_filter", "samples") == expected


def test_the_order_of_options_in_the_file_is_what_counts(write):
    """Twin of the above: sorted names, or the class's own order, would give the same here as there."""
    study = load_study(write(a_study(methods="{sampler: {samples: [3, 2], mip_filter: [box, gauss6]}}")))

    expected = [(3, "box"), (3, "gauss6"), (2, "box"), (2, "gauss6")]
    assert options_of(study.methods, "samples", "mip_filter") == expected


@pytest.mark.parametrize(
    ("stated", "widths"),
    [
        ("[0.2, 0.1]", [[0.2, 0.1]]),
        ("0.2", [[0.2, 0.2]]),
        ("[[0.2, 0.1], [0.3, 0.3]]", [[0.2, 0.1], [0.3, 0.3]]),
        ("[0.2, [0.2, 0.1]]", [[0.2, 0.2], [0.2, 0.1]]),
        ("[0.1, 0.2, 0.3]", [[0.1, 0.1], [0.2, 0.2], [0.3, 0.3]]),
    ],
)
def test_a_list_is_one_value_where_the_option_takes_it(write, stated, widths):
    study = load_study(write(a_study(material=f"{{plain: {{m: {stated}}}}}")))

    assert [item.as_dict()["m"] for item in study.materials] == widths


def test_zip_pairs_options_and_multiplies_with_others(write):
    study = load_study(write(a_study(methods="{sampler: {zip: {samples: [1, 2], bias: [-1, 1]}, gain: [5, 6]}}")))

    expected = [(1, -1, 5), (1, -1, 6), (2, 1, 5), (2, 1, 6)]
    assert options_of(study.methods, "samples", "bias", "gain") == expected


def test_cells_vary_the_method_fastest_and_the_light_slowest(write):
    text = a_study(
        light="{glow: {seed: [1, 2]}}",
        material="{plain: {f0: [0.1, 0.2]}}",
        view="{round: {resolution: [3, 4]}}",
        methods="{sampler: {samples: [5, 6]}}",
    )

    cells = load_study(write(text)).cells()

    found = [
        (
            c.light.as_dict()["seed"],
            c.material.as_dict()["f0"],
            c.view.as_dict()["resolution"],
            c.method.as_dict()["samples"],
        )
        for c in cells
    ]
    assert found == list(product([1, 2], [0.1, 0.2], [3, 4], [5, 6]))


def test_a_tuned_option_takes_its_range_from_its_bounds(write):
    study = load_study(write(a_study(methods="{sampler: {bias: {tune: rms}, samples: [1, 2]}}")))

    assert [item.tune for item in study.methods] == [Tuning("bias", "rms", -2, 2)] * 2
    assert study.methods[0].method.as_dict()["bias"] == 0


def test_a_tuned_option_takes_the_range_that_is_stated(write):
    study = load_study(write(a_study(methods="{sampler: {gain: {tune: max_error, range: [0.5, 1.5]}}}")))

    assert study.methods[0].tune == Tuning("gain", "max_error", 0.5, 1.5)


def test_a_tuned_option_without_a_default_starts_at_its_lowest(write):
    study = load_study(write(a_study(methods="{needy: {width: {tune: rms}}}")))

    assert study.methods[0].method.as_dict() == {"width": 1}


@pytest.mark.parametrize(
    ("entry", "left"),
    [
        ("{seed: 1, samples: 5}", 6),
        ("{method: sampler, seed: [1, 2], samples: 5}", 4),
        ("{light: glow, m: 0.25}", 4),
        ("{m: [0.25, 0.25], samples: 6}", 6),
    ],
)
def test_exclude_drops_the_cells_that_fit_all_of_an_entry(write, entry, left):
    text = a_study(
        light="{glow: {seed: [1, 2]}}",
        material="{plain: {m: [0.25, 0.5, 0.25]}}".replace("0.25, 0.5, 0.25", "[0.25, 0.25], [0.5, 0.5]"),
        methods="{sampler: {samples: [5, 6]}}",
        exclude=f"[{entry}]",
    )

    cells = load_study(write(text)).cells()

    assert len(cells) == left


def test_exclude_spares_a_method_that_lacks_the_option(write):
    methods = "[{sampler: {samples: [5, 6]}}, {needy: {width: 2}}]"

    cells = load_study(write(a_study(methods=methods, exclude="[{samples: 5}]"))).cells()

    assert [cell.method.name for cell in cells] == ["sampler", "needy"]


def test_numbers_are_those_of_yaml_1_2(write):
    text = a_study(reference="{relative_error: 1e-2}", methods="{sampler: {samples: 10, bias: -1.5e0, gain: .5}}")

    study = load_study(write(text))

    assert study.reference.relative_error == 0.01
    assert options_of(study.methods, "samples", "bias", "gain") == [(10, -1.5, 0.5)]


@pytest.mark.parametrize("word", ["yes", "off", "12:30", "2002-06-26", "1_000", '"1e-3"', "'12'"])
def test_what_is_not_a_number_in_yaml_1_2_is_text(write, word):
    assert load_study(write(a_study(title=word))).title == word.strip("\"'")


EVERYTHING = """
title: 1e-3 is not a title, "quoted"
source: "1e-3"
question: |
  Two lines,
  and more.
light: [glow, {glow: {seed: [1, 2]}}]
material: {plain: {m: [[0.2, 0.1], [0.3, 0.3]], tint: 0.5}}
view: round
methods:
  - sampler: {samples: [14, 17], bias: {tune: rms, range: [-1, 1]}}
  - needy: {width: {tune: max_error}}
  - sampler: {zip: {samples: [4, 8], gain: [1.0e-7, .inf]}}
reference: {relative_error: 1e-2, seed: 3, max_samples: 2048}
metrics: [rms, max_error]
claims:
  - {text: A, lower: sampler, than: needy, metric: rms, where: {samples: [14, 17]}}
  - {text: B, slope: sampler, over: samples, metric: max_error, between: [null, -0.4]}
  - {text: C, ratio: [sampler, needy], of: state_bytes, between: [0.5, 2]}
  - {text: D, value: sampler, of: n_samples, equals: 14, where: {light: glow, m: [[0.2, 0.1]]}}
exclude: [{seed: 1, samples: 14}, {method: needy, light: glow, m: 0.3}]
seed: 5
device: cuda
plugins: [json]
"""


def test_a_resolved_study_loads_as_an_equal_one(write):
    study = load_study(write(EVERYTHING))

    again = load_study(write(dump(study.resolved())))

    assert again == study
    assert again.cells() == study.cells()
    assert again.resolved() == study.resolved()


@pytest.mark.parametrize(
    "change",
    [
        "seed: 6",
        "device: cpu",
        "metrics: [max_error, rms]",
        "reference: {relative_error: 1e-3}",
        "exclude: []",
    ],
)
def test_the_round_trip_would_notice_a_lost_key(write, change):
    """Twin of the above: one key of the resolved study changed, and the studies differ."""
    study = load_study(write(EVERYTHING))

    key, value = change.split(": ", 1)
    again = load_study(write(dump(study.resolved() | {key: yaml.safe_load(value.replace("1e-3", "0.001"))})))

    assert again != study


def test_items_are_distinguished_by_canonical_json(write):
    first, second = (
        load_study(write(a_study(methods=f"{{sampler: {{{options}}}}}"))).methods[0]
        for options in ("samples: 3, bias: {tune: rms}", "bias: {range: [-2, 2], tune: rms}, samples: 3")
    )

    assert to_text(first) == to_text(second)
    assert first.as_dict()["bias"] == {"tune": "rms", "range": [-2, 2]}
    assert to_text(first) != to_text(dataclasses.replace(first, tune=None))


# The seed

SEEDS = """
title: T
light: {glow: {seed: [1, 2]}}
material: plain
view: round
methods:
  - drawn: {samples: [1, 2]}
  - drawn: {samples: 3, seed: 5}
  - drawn: {zip: {samples: [4], seed: [6]}}
  - sampler
seed: 7
"""


def seeds_of(study):
    return [item.method.as_dict().get("seed") for item in study.methods]


def test_the_seed_of_the_study_is_that_of_all_that_states_none(write):
    study = load_study(write(SEEDS))

    assert seeds_of(study) == [7, 7, 5, 6, None]
    assert study.reference.seed == 7
    assert options_of(study.lights, "seed") == [(1,), (2,)]


def test_another_seed_replaces_what_followed_from_the_first_and_no_more(write):
    study = load_study(write(SEEDS)).with_seed(8).with_seed(9)

    assert (study.seed, study.reference.seed) == (9, 9)
    assert seeds_of(study) == [9, 9, 5, 6, None]
    assert options_of(study.lights, "seed") == [(1,), (2,)]


def test_another_seed_is_as_if_the_study_had_stated_it(write):
    assert load_study(write(SEEDS)).with_seed(9) == load_study(write(SEEDS.replace("seed: 7", "seed: 9")))


def test_a_stated_seed_of_the_reference_stays(write):
    study = load_study(write(SEEDS + "reference: {seed: 0}\n"))

    assert study.reference.seed == study.with_seed(9).reference.seed == 0


def test_a_resolved_study_states_every_seed(write):
    study = load_study(write(SEEDS))

    again = load_study(write(dump(study.resolved())))

    assert again == study
    assert seeds_of(again.with_seed(9)) == seeds_of(study)
    assert again.with_seed(9).reference.seed == 7


@pytest.mark.parametrize(
    ("seed", "message"),
    [
        (-1, "seed must be at least 0, got -1"),
        (101, "drawn.seed must be less than or equal to 100, got 101"),
        (5, "seed 5 is also the stated seed of a method of the study, which would then be there twice"),
    ],
)
def test_a_seed_that_does_not_fit_is_an_error(write, seed, message):
    study = load_study(write(SEEDS.replace("samples: [1, 2]", "samples: 3")))

    with pytest.raises(InputError, match=f"^{message}$"):
        study.with_seed(seed)


def test_a_seed_in_the_file_that_a_method_does_not_take_is_pointed_at(write):
    message = error_of(write(SEEDS.replace("seed: 7", "seed: 101")))

    assert message == "my.yaml:7:12: methods[0].drawn.seed must be less than or equal to 100, got 101"


# Fewer methods


def test_a_study_of_some_methods_keeps_what_is_said_of_them(write):
    claims = [
        "{text: A, value: sampler, of: rms, between: [0, 1]}",
        "{text: B, lower: sampler, than: needy, metric: rms}",
    ]
    text = a_study(
        methods="[{sampler: {samples: [1, 2]}}, {needy: {width: [2, 3]}}]",
        claims=f"[{', '.join(claims)}]",
        exclude="[{samples: 1}, {width: 2, light: glow}]",
    )

    study = load_study(write(text)).only(["sampler"])

    assert options_of(study.methods, "samples") == [(1,), (2,)]
    assert [claim.text for claim in study.claims] == ["A"]
    assert study.exclude == ({"samples": 1},)
    assert load_study(write(dump(study.resolved()))) == study


def test_methods_that_are_all_excluded_are_an_error(write):
    study = load_study(write(a_study(methods="[sampler, {needy: {width: 2}}]", exclude="[{samples: 40}]")))

    with pytest.raises(InputError, match="exclude leaves no cell"):
        study.only(["sampler"])


def test_a_method_that_the_study_lacks_offers_the_nearest(write):
    with pytest.raises(InputError, match=r"^the study has no method 'samplr'; did you mean 'sampler'\?$"):
        load_study(write(a_study())).only(["samplr"])


# Files of light


@pytest.mark.parametrize(
    "light", ["probe.hdr", "{file: probe.hdr}", "{file: {file: probe.hdr}}", "[{file: [probe.hdr]}]"]
)
def test_a_light_may_be_a_file(write, light):
    Path("probe.hdr").touch()

    study = load_study(write(a_study(light=light)))

    assert study.lights[0].name == "file"
    assert study.lights[0].as_dict()["file"] == "probe.hdr"
    assert study.lights[0].as_dict()["resolution"] is None


def test_a_file_next_to_the_study_is_found_from_anywhere(write, tmp_path, monkeypatch):
    write(a_study(light="{file: probe.hdr, resolution: 32}"))
    Path("probe.hdr").touch()
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)

    study = load_study("../my.yaml")

    assert Path(study.lights[0].as_dict()["file"]).is_absolute()
    assert Path(study.lights[0].as_dict()["file"]).samefile(tmp_path / "probe.hdr")
    assert Path(study.folder).samefile(tmp_path)


def test_a_file_among_the_data_keeps_its_name(write, tmp_path, monkeypatch):
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "probe.hdr").touch()
    monkeypatch.setenv("GLOSSBENCH_DATA", str(tmp_path / "data"))

    study = load_study(write(a_study(light="probe.hdr")))

    assert study.lights[0].as_dict()["file"] == "probe.hdr"


def test_another_light_replaces_the_lights_and_what_is_said_of_them(write):
    Path("probe.hdr").touch()
    claim = "[{text: A, value: sampler, of: rms, between: [0, 1], where: {light: glow}}]"
    text = a_study(light="[gone.hdr, glow]", claims=claim, exclude="[{light: glow}]")

    study = load_study(write(text), light="probe.hdr")

    assert options_of(study.lights, "file") == [("probe.hdr",)]
    assert study.exclude == ()
    assert len(study.claims) == len(study.cells()) == 1


def test_a_missing_light_file_is_an_error(write):
    with pytest.raises(InputError, match=r"^no image file 'gone.hdr'"):
        load_study(write(a_study()), light="gone.hdr")


# Names of studies


def test_an_installed_study_has_a_name(tmp_path, monkeypatch):
    (tmp_path / "quickstart.yaml").write_text(a_study())
    monkeypatch.setattr(resources, "files", lambda package: tmp_path)

    study = load_study("quickstart")

    assert (study.name, study.title) == ("quickstart", "T")


def test_studies_are_listed_by_name(tmp_path, monkeypatch):
    for name in ("b.yaml", "a.yaml", "__init__.py", "notes.txt"):
        (tmp_path / name).touch()
    monkeypatch.setattr(resources, "files", lambda package: tmp_path)

    assert list(find_study_files()) == ["a", "b"]


def test_an_unknown_study_offers_the_nearest(tmp_path, monkeypatch):
    (tmp_path / "quickstart.yaml").write_text(a_study())
    monkeypatch.setattr(resources, "files", lambda package: tmp_path)

    with pytest.raises(InputError, match=r"^unknown study 'quikstart'; did you mean 'quickstart'\?$"):
        load_study("quikstart")


@pytest.mark.parametrize(("path", "why"), [("none.yaml", "No such file"), (Path("."), "Is a directory")])
def test_an_unreadable_study_is_an_error(write, path, why):
    with pytest.raises(InputError, match=why):
        load_study(path)


# Plug-ins


def test_plugins_are_imported_before_names_are_resolved(write, tmp_path, monkeypatch):
    code = (
        "from glossbench.shading.method import METHODS, Method\n"
        "@METHODS.register('late')\nclass Late(Method):\n    samples: int = 1\n"
    )
    (tmp_path / "study_test_plugin.py").write_text(code)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "study_test_plugin", raising=False)

    study = load_study(write(a_study(methods="late", plugins="[study_test_plugin]")))

    assert study.methods[0].name == "late"


def test_a_plugin_is_found_next_to_the_study(write, tmp_path, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.setattr(sys, "path", [*sys.path])
    (tmp_path / "study_test_beside.py").write_text(
        "from glossbench.shading.method import METHODS, Method\n"
        "@METHODS.register('beside')\nclass Beside(Method):\n    samples: int = 1\n"
    )
    path = Path(write(a_study(methods="beside", plugins="[study_test_beside]"))).absolute()
    monkeypatch.chdir(tmp_path / "elsewhere")

    assert load_study(path).methods[0].name == "beside"


def test_a_plugin_that_breaks_is_named_with_its_exception(write, tmp_path, monkeypatch):
    (tmp_path / "study_test_broken.py").write_text("raise RuntimeError('two\\nlines')")
    monkeypatch.syspath_prepend(tmp_path)

    message = error_of(write(a_study(plugins="[study_test_broken]")))

    assert message == "my.yaml:6:11: plugin 'study_test_broken': RuntimeError: two lines"


# Errors: one line, with file, line and column


def error_of(path: str) -> str:
    with pytest.raises(InputError) as caught:
        load_study(path)
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 700
    return message


WRONG = [
    # The file
    ("", "1:1: the file is empty"),
    ("# only this\n", "1:1: the file is empty"),
    ("- title: T\n", "1:1: the top must be a mapping of keys, got a list"),
    ("hello\n", "1:1: the top must be a mapping of keys, got 'hello'"),
    ("title: T\nlight: [glow\nview: x\n", "3:5: expected ',' or ']', but got ':'"),
    ("title: T\nlight:\n\t- glow\n", "3:1: a tab cannot indent; use spaces"),
    ("title: T\n---\ntitle: U\n", "2:1: but found another document"),
    ("title: &a [*b]\n", "1:12: found undefined alias 'b'"),
    ("title: T\ntitle: U\n", "2:1: key 'title' is already on line 1"),
    ("light:\n  glow: {seed: 1, seed: 2}\n", "2:19: light.glow: key 'seed' is already on line 2"),
    ("1: T\n", "1:1: a key must be text, got '1'"),
    (
        "title: !!python/object:os.system x\n",
        "1:8: tag 'tag:yaml.org,2002:python/object:os.system' is not allowed",
    ),
    ("title: !!int many\n", "1:8: 'many' is not a valid int"),
    ("title: T\nlight: a\x07b\n", "2:9: character U+0007 is not allowed in YAML"),
    ("title: &a [*a]\n", "1:8: more than 64 levels deep, or an alias inside itself"),
    # The top level
    (a_study(title=None), "1:1: key 'title' is required"),
    (a_study(metric="rms"), "6:1: unknown key 'metric'; did you mean 'metrics'?"),
    (a_study(methods=None, method="sampler"), "5:1: unknown key 'method'; did you mean 'methods'?"),
    (a_study(title="12"), "1:8: title must be a valid string, got 12"),
    (a_study(seed="-1"), "6:7: seed must be greater than or equal to 0, got -1"),
    (a_study(device="tpu"), "6:9: device must be 'cpu' or 'cuda', got 'tpu'; did you mean 'cpu'?"),
    (a_study(metrics="[rms, rsm]"), "6:16: metrics[1]: unknown metric 'rsm'; did you mean 'rms'?"),
    (a_study(metrics="[rms, rms]"), '6:16: metrics[1] states the same twice: rms {"space": "linear"}'),
    (
        a_study(reference="{relative_error: 0}"),
        "6:29: reference.relative_error must be greater than 0, got 0",
    ),
    (a_study(reference="{error: 1}"), "6:13: reference: unknown key 'error'; did you mean 'relative_error'?"),
    (
        a_study(reference="{max_samples: 10}"),
        "6:26: reference.max_samples must be greater than or equal to 1024, got 10",
    ),
    (
        a_study(plugins="[no_such_module_here]"),
        "6:11: plugin 'no_such_module_here': no such module: not in ",
    ),
    # Items
    (a_study(methods="[]"), "5:10: methods needs at least one item"),
    (a_study(methods="samplr"), "5:10: methods: unknown method 'samplr'; did you mean 'sampler'?"),
    (
        a_study(methods="[sampler, {samplr: }]"),
        "5:21: methods[1]: unknown method 'samplr'; did you mean 'sampler'?",
    ),
    (a_study(light="glo"), "2:8: light: unknown light 'glo'; did you mean 'glow'?"),
    (
        a_study(light="{glow: , seed: 1}"),
        "2:8: light must be a name, or one name with its options below it, got the keys 'glow', 'seed'",
    ),
    (a_study(light="3"), "2:8: light must be a name, or one name with its options below it, got 3"),
    (a_study(view="{round: 3}"), "4:15: view.round: options must be a mapping, got 3"),
    (a_study(light="gone.hdr"), "2:8: light.file: no image file 'gone.hdr': not in "),
    (a_study(light="{file: gone.hdr}"), "2:15: light.file: no image file 'gone.hdr': not in "),
    (a_study(light="{file: 3}"), "2:15: light.file must be a valid string, got 3"),
    # Options and sweeps
    (
        a_study(methods="\n- sampler:\n    samples: 0"),
        "7:14: methods[0].sampler.samples must be greater than or equal to 1, got 0",
    ),
    (
        a_study(methods="{sampler: {sample: 1}}"),
        "5:21: methods.sampler: unknown option 'sample'; did you mean 'samples'?",
    ),
    (
        a_study(methods="{sampler: {samples: [1, 0]}}"),
        "5:34: methods.sampler.samples[1] must be greater than or equal to 1, got 0",
    ),
    (a_study(methods="{sampler: {samples: []}}"), "5:30: methods.sampler.samples sweeps an empty list"),
    (
        a_study(methods="{sampler: {samples: '40'}}"),
        "5:30: methods.sampler.samples must be a valid integer, got '40'",
    ),
    (
        a_study(methods="{sampler: {samples: yes}}"),
        "5:30: methods.sampler.samples must be a valid integer, got 'yes'",
    ),
    (
        a_study(methods="{sampler: {mip_filter: bx}}"),
        "5:33: methods.sampler.mip_filter must be 'box' or 'gauss6', got 'bx'; did you mean 'box'?",
    ),
    (
        a_study(material="{plain: {m: [0.5, 2]}}"),
        "3:29: material.plain.m[1]",
    ),
    (
        a_study(material="{plain: {m: [[0.5, 2]]}}"),
        "3:24: material.plain.m[0][1] must be less than or equal to 1, got 2",
    ),
    (a_study(methods="needy"), "5:10: methods: option 'width' is required"),
    (
        a_study(methods="{sampler: {samples: 2000}}"),
        "5:20: methods.sampler: more than 1000 samples need gauss6",
    ),
    (
        a_study(methods="[sampler, {sampler: {samples: [3, 40]}}]"),
        "5:30: methods[1].sampler states the same twice: ",
    ),
    (
        a_study(methods="{sampler: {samples: [3, 3]}}"),
        "5:20: methods.sampler states the same twice: sampler ",
    ),
    # zip
    (
        a_study(methods="{sampler: {zip: {samples: [1, 2], bias: [0]}}}"),
        "5:26: methods.sampler.zip pairs lists of equal length, but samples has 2, bias has 1",
    ),
    (
        a_study(methods="{sampler: {zip: {samples: 1}}}"),
        "5:26: methods.sampler.zip must map options to lists, got ",
    ),
    (
        a_study(methods="{sampler: {zip: {sample: [1]}}}"),
        "5:27: methods.sampler.zip: unknown option 'sample'; did you mean",
    ),
    (
        a_study(methods="{sampler: {zip: {samples: [1, 0]}}}"),
        "5:40: methods.sampler.zip.samples[1] must be greater than",
    ),
    (
        a_study(methods="{sampler: {samples: 1, zip: {samples: [1]}}}"),
        "5:21: methods.sampler: 'samples' is in 'zip', too",
    ),
    # tune
    (
        a_study(methods="{sampler: {bias: {tune: rsm}}}"),
        "5:34: methods.sampler.bias.tune: unknown metric 'rsm'; did you",
    ),
    (
        a_study(methods="{sampler: {bias: {tune: ssim}}}"),
        "5:34: methods.sampler.bias.tune: ssim is higher for better images; tune",
    ),
    (
        a_study(methods="{sampler: {gain: {tune: rms}}}"),
        "5:27: methods.sampler.gain has no bounds to tune between; state",
    ),
    (
        a_study(methods="{sampler: {gain: {tune: rms, range: [2, 1]}}}"),
        "5:46: methods.sampler.gain.range must be [low, high], low first, got [2.0, 1.0]",
    ),
    (a_study(methods="{sampler: {gain: {tune: rms, range: [1]}}}"), "5:46: methods.sampler.gain.range "),
    (
        a_study(methods="{sampler: {bias: {tune: rms, range: [-3, 1]}}}"),
        "5:46: methods.sampler.bias.range must be greater than or equal to -2, got -3.0",
    ),
    (
        a_study(methods="{sampler: {bias: {tune: rms, rang: [0, 1]}}}"),
        "5:39: methods.sampler.bias: unknown key 'rang'; did",
    ),
    (
        a_study(methods="{sampler: {bias: {tune: rms}, gain: {tune: rms, range: [0, 1]}}}"),
        "5:46: methods.sampler.gain: only one option of an item can be tuned",
    ),
    (
        a_study(material="{plain: {f0: {tune: rms}}}"),
        "3:24: material.plain.f0: only an option of a method can be tuned",
    ),
    (
        a_study(methods="{sampler: {samples: {tune: rms, range: [1, 9]}}}"),
        "5:30: methods.sampler.samples: only an option that takes fractions can be tuned; sweep this one: a list of",
    ),
    # exclude
    (a_study(exclude="[{samples: 41}]"), "6:11: exclude[0] fits no cell"),
    (a_study(exclude="[{}]"), "6:11: exclude[0] fits no cell"),
    (a_study(exclude="[{sampls: 41}]"), "6:12: exclude[0]: unknown key 'sampls'; did you mean 'samples'?"),
    (a_study(exclude="[{method: sampler}]"), "6:10: exclude leaves no cell"),
    (a_study(exclude="{method: sampler}"), "6:10: exclude must be a valid list"),
    # claims
    (
        a_study(claims="[{text: A}]"),
        "6:10: claims[0] needs one of the keys lower, slope, ratio, value, got none",
    ),
    (
        a_study(claims="[{text: A, value: sampler, ratio: [a, b]}]"),
        "6:10: claims[0] needs one of the keys lower, slope, ratio, value, got ratio and value",
    ),
    (a_study(claims="[A]"), "6:10: claims[0] needs one of the keys lower, slope, ratio, value, got none"),
    (
        a_study(claims="[{text: A, lower: sampler, than: samplr, metric: rms}]"),
        "6:42: claims[0].than: no method 'samplr' in this study; did you mean 'sampler'?",
    ),
    (a_study(claims="[{text: A, lower: sampler, metric: rms}]"), "6:10: claims[0]: key 'than' is required"),
    (
        a_study(claims="[{text: A, lower: {sampler: {}, light: glo}, than: sampler, metric: rms}]"),
        "6:48: claims[0].lower.light: no light 'glo' in this study; did you mean 'glow'?",
    ),
    (
        a_study(claims="[{text: A, lower: {light: glow}, than: sampler, metric: rms}]"),
        "6:27: claims[0].lower must be a method, or {method: {option: value}}; further keys may be light, "
        "material and view",
    ),
    (
        a_study(claims="[{text: A, lower: sampler, than: sampler, metric: rsm}]"),
        "6:59: claims[0].metric: no metric 'rsm' in this study; did you mean 'rms'?",
    ),
    (
        a_study(claims="[{text: A, value: sampler, of: seconds, between: [0, 1]}]"),
        "6:40: claims[0].of: no column 'seconds'",
    ),
    (
        a_study(claims="[{text: A, value: sampler, of: rms, between: [1, 0]}]"),
        "6:54: claims[0].between must be [low, high] with low at most high",
    ),
    (
        a_study(claims="[{text: A, value: sampler, of: rms, between: [null, null]}]"),
        "6:54: claims[0].between must have a number for at least one bound",
    ),
    (
        a_study(claims="[{text: A, value: sampler, of: rms}]"),
        "6:10: claims[0] needs either 'between' or 'equals'",
    ),
    (
        a_study(claims="[{text: A, value: sampler, of: rms, equals: 1, when: 2}]"),
        "6:56: claims[0]: unknown key 'when'; did",
    ),
    (
        a_study(claims="[{text: A, slope: sampler, over: sample, metric: rms, between: [-1, 0]}]"),
        "6:42: claims[0].over: no option of sampler 'sample' in this study; did you mean 'samples'?",
    ),
    (
        a_study(claims="[{text: A, slope: sampler, over: resolution, metric: rms, between: [-1, 0]}]"),
        "6:42: claims[0].over: 'resolution' may mean light.resolution or view.resolution: say which",
    ),
    (
        a_study(claims="[{text: A, slope: sampler, over: material.n, metric: rms, between: [-1, 0]}]"),
        "6:42: claims[0].over: no option of sampler 'material.n' in this study",
    ),
    (
        a_study(claims="[{text: A, ratio: [sampler, samplr], of: rms, between: [0, 1]}]"),
        "6:37: claims[0].ratio[1]: no method 'samplr'",
    ),
    (
        a_study(claims="[{text: A, lower: sampler, than: sampler, metric: rms, paired_by: sample}]"),
        "6:75: claims[0].paired_by: no option of both methods 'sample'",
    ),
    (
        a_study(claims="[{text: A, lower: sampler, than: sampler, metric: rms, by: sample}]"),
        "6:68: claims[0].by: no option of its methods 'sample' in this study; did you mean 'samples'?",
    ),
    (
        a_study(claims="[{text: A, value: sampler, of: rms, equals: 1, where: {sample: 1}}]"),
        ("6:72: claims[0].where.sample: no option 'sample' of its methods or materials; did you mean 'samples'?"),
    ),
    (
        a_study(claims="[{text: A, value: sampler, of: rms, equals: 1, where: {light: glo}}]"),
        "6:71: claims[0].where.light: no light 'glo' in this study; did you mean 'glow'?",
    ),
]


@pytest.mark.parametrize(("text", "message"), WRONG, ids=[message[:60] for _, message in WRONG])
def test_an_error_is_one_line_that_says_where(write, text, message):
    assert error_of(write(text)).startswith(f"my.yaml:{message}")


def test_bytes_that_are_not_utf_8_are_pointed_at(write):
    assert error_of(write(b"title: T\nlight: \xc3\xa4\xff\n")) == "my.yaml:2:9: byte 0xff is not UTF-8"


def test_a_file_that_begins_with_a_byte_order_mark_is_read(write):
    assert load_study(write(b"\xef\xbb\xbf" + a_study().encode())).title == "T"


def test_a_large_file_is_refused(write):
    assert error_of(write("#" * 1_000_001)) == "my.yaml:1:1: the file is larger than 1000000 bytes"


def test_aliases_that_stand_for_gigabytes_are_refused(write):
    bomb = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n"
    for i in range(1, 12):
        bomb += f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n"

    assert "more than 100000 values, aliases counted at each use" in error_of(write(bomb))


def test_an_alias_of_modest_size_is_welcome(write):
    """Twin of the above: it is not aliases that are refused."""
    text = a_study(methods="\n- sampler: &s {samples: [1, 2]}\n- needy: {width: 2}", light="{glow: &g {seed: 3}}")

    study = load_study(write(text.replace("view: round", "view: {round: {resolution: &r 4}}")))

    assert len(study.methods) == 3


@pytest.mark.parametrize("depth", [70, 100_000])
def test_deep_nesting_is_refused(write, depth):
    assert "more than 64 levels deep" in error_of(write("title: " + "[" * depth + "]" * depth))


def test_too_many_cells_are_counted_and_not_built(write):
    many = list(range(1, 1001))
    text = a_study(
        light=f"{{glow: {{seed: {many}}}}}",
        view=f"{{round: {{resolution: {many}}}}}",
        methods=f"{{sampler: {{gain: {many}}}}}",
    )

    assert error_of(write(text)) == "my.yaml:5:1: the study has 1000000000 cells, more than 100000"


def test_a_long_value_does_not_make_a_long_message(write):
    message = error_of(write(a_study(methods=f"{{sampler: {{samples: {'x' * 5000}}}}}")))

    assert message.endswith("...")


# Editors


def test_the_schema_has_every_name_and_option():
    stated = schema()

    def of(part: dict) -> dict:
        return stated["$defs"][part["$ref"].removeprefix("#/$defs/")] if "$ref" in part else part

    method = of(of(stated["properties"]["methods"])["anyOf"][0])["anyOf"]
    assert of(method[0])["enum"] == ["drawn", "needy", "sampler"]
    options = of(of(of(method[1])["properties"]["sampler"])["anyOf"][0])
    assert set(options["properties"]) == {"samples", "bias", "gain", "mip_filter", "zip"}
    assert of(options["properties"]["samples"])["default"] == 40
    assert options["description"] == "A method of the tests."
    assert set(stated["required"]) == {"title", "light", "material", "view", "methods"}
    assert stated["additionalProperties"] is False


def test_every_reference_in_the_schema_is_defined():
    stated = schema()

    text = json.dumps(stated)

    names = set(re.findall(r'"#/\$defs/([\w.]+)"', text))
    assert names == set(stated["$defs"])
    assert {"ReferenceOptions", "Coat"} <= names
    assert text.count('"$defs"') == 1


def test_the_dumper_keeps_text_that_looks_like_a_number(write):
    data = {
        "a": "1e-3",
        "b": 1e-3,
        "c": "yes",
        "d": "null",
        "e": None,
        "f": [True, "true", 0.1, -math.inf, "0o7"],
    }

    again = yaml_marks.read_document(Path(write(dump(data)))).data

    assert again == data
    assert [type(v) for v in again["f"]] == [type(v) for v in data["f"]]
