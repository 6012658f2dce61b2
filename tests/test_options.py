"""Options and registries: what is refused, and in which words."""

from typing import Annotated, Literal

import numpy as np
import pytest
from pydantic import Field, TypeAdapter, ValidationError

from glossbench.brdf.material import MATERIALS
from glossbench.envmap.lights.light import LIGHTS
from glossbench.errors import InputError, suggest_nearest
from glossbench.metrics import METRICS
from glossbench.options import Color, Finite, Fraction, NonNegative, Options, Width, Widths, check, make_schema
from glossbench.registry import Registry
from glossbench.scene.points import VIEWS
from glossbench.shading.method import METHODS

REGISTRIES = {"light": LIGHTS, "material": MATERIALS, "view": VIEWS, "method": METHODS, "metric": METRICS}


class Lamp(Options):
    name = "lamp"

    samples: Annotated[int, Field(ge=1, le=64)] = 40
    power: NonNegative = 1.0
    share: Fraction = 0.5
    offset: Finite = 0.0
    m: Widths = (0.1, 0.1)
    width: Width = 0.1
    tint: Color = (1.0, 1.0, 1.0)
    shape: Literal["disc", "square"] = "disc"
    on: bool = True
    seed: Annotated[int, Field(ge=0)] | None = None


class Bulb(Options):
    name = "bulb"

    watts: NonNegative
    socket: str = "E27"


def refused(options):
    with pytest.raises(InputError) as raised:
        Lamp.create(options)
    text = str(raised.value)
    assert "\n" not in text
    return text


ACCEPTED = [
    ("samples", 1, 1),
    ("power", 2, 2.0),
    ("m", 0.2, (0.2, 0.2)),
    ("m", [0.2, 0.1], (0.2, 0.1)),
    ("m", (0.2, 0.1), (0.2, 0.1)),
    ("tint", 0.5, (0.5, 0.5, 0.5)),
    ("tint", [1, 0, 0.5], (1.0, 0.0, 0.5)),
    ("on", False, False),
    ("seed", None, None),
    ("seed", 3, 3),
]


@pytest.mark.parametrize(("option", "value", "expected"), ACCEPTED)
def test_a_valid_value_is_kept_or_spread(option, value, expected):
    lamp = Lamp.create({option: value})

    kept = getattr(lamp, option)

    assert kept == expected
    assert type(kept) is type(expected)


NAN, INF = float("nan"), float("inf")
REFUSED = [
    ("samples", "40", "lamp.samples must be a valid integer, got '40'"),
    ("samples", True, "lamp.samples must be a valid integer, got True"),
    ("samples", 40.0, "lamp.samples must be a valid integer, got 40.0"),
    ("samples", None, "lamp.samples must be a valid integer, got None"),
    ("samples", 0, "lamp.samples must be greater than or equal to 1, got 0"),
    ("samples", 65, "lamp.samples must be less than or equal to 64, got 65"),
    ("power", "1", "lamp.power must be a valid number, got '1'"),
    ("power", True, "lamp.power must be a valid number, got True"),
    ("power", NAN, "lamp.power must be a finite number, got nan"),
    ("power", INF, "lamp.power must be a finite number, got inf"),
    ("power", -0.1, "lamp.power must be greater than or equal to 0, got -0.1"),
    ("offset", NAN, "lamp.offset must be a finite number, got nan"),
    ("offset", -INF, "lamp.offset must be a finite number, got -inf"),
    ("share", 1.01, "lamp.share must be less than or equal to 1, got 1.01"),
    ("width", 0, "lamp.width must be greater than 0, got 0"),
    ("m", [0.1, 1.4], "lamp.m[1] must be less than or equal to 1, got 1.4"),
    ("m", "0.1", "lamp.m must be a list, got '0.1'"),
    ("m", True, "lamp.m must be a list, got True"),
    ("tint", [1, -1, 1], "lamp.tint[1] must be greater than or equal to 0, got -1"),
    ("shape", "disk", "lamp.shape must be 'disc' or 'square', got 'disk'; did you mean 'disc'?"),
    ("shape", "round", "lamp.shape must be 'disc' or 'square', got 'round'"),
    ("on", 1, "lamp.on must be a valid boolean, got 1"),
    ("on", "yes", "lamp.on must be a valid boolean, got 'yes'"),
]


@pytest.mark.parametrize(("option", "value", "message"), REFUSED)
def test_an_invalid_value_is_refused_by_name_rule_and_value(option, value, message):
    assert refused({option: value}) == message


@pytest.mark.parametrize("option", ["share", "width", "m", "tint"])
def test_nan_is_within_no_bounds(option):
    assert refused({option: NAN}).endswith("got nan")


@pytest.mark.parametrize(
    ("option", "value"), [("m", [0.1]), ("m", [0.1] * 3), ("m", []), ("tint", [1, 1]), ("tint", [1] * 4)]
)
def test_a_vector_of_the_wrong_length_is_refused(option, value):
    text = refused({option: value})

    assert text.startswith(f"lamp.{option}")


def test_an_array_is_refused_in_one_line():
    text = refused({"m": np.eye(2)})

    assert text.startswith("lamp.m must be a list, got array([[1., 0.], [0., 1.]])")


def test_a_lax_check_would_take_what_is_refused():
    lax = TypeAdapter(Annotated[int, Field(ge=1, le=64)])

    # What the strict rule is there for: pydantic by itself takes all three for numbers.
    assert [lax.validate_python(v) for v in ("40", True, 40.0)] == [40, 1, 40]
    with pytest.raises(ValidationError):
        lax.validate_python("40", strict=True)


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("sampels", "lamp: unknown option 'sampels'; did you mean 'samples'?"),
        ("Width", "lamp: unknown option 'Width'; did you mean 'width'?"),
        (1, "lamp: unknown option 1; known: m, offset, on, power, samples, seed, shape, share, tint, width"),
    ],
)
def test_an_unknown_option_offers_the_nearest(key, message):
    assert refused({key: 1}) == message


def test_a_missing_option_is_named():
    with pytest.raises(InputError, match=r"^bulb: option 'watts' is required$"):
        Bulb.create({"socket": "E14"})


def test_a_value_set_in_python_is_checked_as_one_from_a_study():
    with pytest.raises(InputError, match=r"^lamp\.samples must be greater than or equal to 1, got 0$"):
        Lamp(samples=0)


def test_options_cannot_be_changed_afterwards():
    lamp = Lamp()

    with pytest.raises(AttributeError):
        lamp.samples = 3


def test_options_as_dict_make_the_same_options_again():
    lamp = Lamp(m=(0.3, 0.1), tint=(1.0, 0.5, 0.0), seed=4)

    values = lamp.as_dict()

    assert values["m"] == [0.3, 0.1]
    assert Lamp.create(values) == lamp


def test_the_schema_names_bounds_and_defaults():
    schema = make_schema(Lamp)

    assert schema["properties"]["samples"] == {"type": "integer", "minimum": 1, "maximum": 64, "default": 40}
    assert schema["properties"]["shape"]["enum"] == ["disc", "square"]
    assert schema["additionalProperties"] is False


# What is registered


def every_option():
    return [
        pytest.param(cls, option, id=f"{kind}-{name}-{option}")
        for kind, registry in REGISTRIES.items()
        for name in registry.names()
        for cls in [registry.get(name)]
        for option in make_schema(cls)["properties"]
    ]


@pytest.mark.parametrize(("cls", "option"), every_option())
def test_no_registered_option_takes_nan(cls, option):
    with pytest.raises(InputError, match=rf"^{cls.name}\.{option}"):
        check(cls, option, NAN)


# Registries


def new_registry():
    return Registry("lamp", "glossbench.errors", "glossbench.no_such_group")


def test_a_registered_class_is_found_by_its_name():
    registry = new_registry()

    registry.register("arc")(Lamp)

    try:
        assert registry.get("arc") is Lamp
        assert registry.names() == ["arc"]
        assert registry.create("arc", {"samples": 3}).samples == 3
    finally:
        Lamp.name = "lamp"


def test_two_classes_of_one_name_are_refused():
    registry = new_registry()
    registry.register("bulb")(Bulb)

    with pytest.raises(InputError) as raised:
        registry.register("bulb")(Lamp)

    assert str(raised.value).startswith("lamp 'bulb' is registered twice: in ")
    assert Lamp.name == "lamp"


def test_registering_the_same_class_again_is_harmless():
    registry = new_registry()

    for _ in range(2):
        registry.register("bulb")(Bulb)

    assert registry.names() == ["bulb"]


@pytest.mark.parametrize(
    ("kind", "name", "hint"),
    [
        ("light", "spts", "; did you mean 'spots'?"),
        ("material", "kurrt", "; did you mean 'kurt'?"),
        ("view", "shpere", "; did you mean 'sphere'?"),
        ("method", "importance_samplng", "; did you mean 'importance_sampling'?"),
        ("metric", "RMS", "; did you mean 'rms'?"),
    ],
)
def test_an_unknown_name_offers_the_nearest(kind, name, hint):
    with pytest.raises(InputError) as raised:
        REGISTRIES[kind].get(name)

    assert str(raised.value) == f"unknown {kind} {name!r}{hint}"


def test_a_name_that_is_near_none_lists_them_all():
    assert suggest_nearest("zzz", ["b", "a"]) == "; known: a, b"
    assert suggest_nearest("zzz", []) == ""
