"""Return values of plug-ins other than radiance: valid ones are used, any other is an error of the plug-in."""

import numpy as np
import pytest
import torch

import glossbench as gb
from glossbench.errors import MethodError
from glossbench.scene.points import View
from glossbench.shading.outputs import (
    check_view,
    count_of,
    key_text,
    notes_of,
    number_of,
    pattern_of,
    pictures_of,
    reason_of,
)

RIGHT = [
    (reason_of, None, None),
    (reason_of, "only round lobes", "only round lobes"),
    (count_of, 0, 0),
    (count_of, np.int32(7), 7),
    (count_of, torch.tensor(7), 7),
    (notes_of, [], []),
    (notes_of, ("a", "b"), ["a", "b"]),
    (notes_of, ("\ud800",), ["\\ud800"]),
    (number_of, 1, 1.0),
    (number_of, np.float32(0.5), 0.5),
    (number_of, torch.tensor(0.5), 0.5),
    (number_of, float("inf"), float("inf")),
    (key_text, "a", "a"),
    (pattern_of, None, None),
    (pictures_of, {}, {}),
]
PICTURE = torch.ones(2, 3, 3)
WRONG = [
    *((reason_of, value) for value in ("", " \n", True, False)),
    *((count_of, value) for value in (-1, 10**30, 1.5, "7", None, True, torch.ones(2), float("nan"))),
    *((notes_of, value) for value in ("a sentence", None, [1], {"a": 1}, 7)),
    *((number_of, value) for value in (float("nan"), "1", None, 10**400, 1j, True, [1.0], torch.ones(2))),
    *((key_text, value) for value in (None, 7, b"a")),
    *((pattern_of, value) for value in (torch.ones(5), torch.ones(5, 3), np.ones((5, 2)), [[1, 2]], 7)),
    (pattern_of, torch.full((5, 2), float("nan"))),
    (pattern_of, torch.ones(5, 2) + 0j),
    *((pictures_of, value) for value in (None, [PICTURE], PICTURE)),
    *((pictures_of, {name: PICTURE}) for name in ("a/b", "", "..", ".a", "a\n", "a" * 81, 7, "é")),
    *((pictures_of, {"a": value}) for value in (torch.ones(2, 2), torch.ones(2, 2, 4), np.ones((2, 2, 3)), None)),
    *((pictures_of, {"a": torch.full((2, 2, 3), value)}) for value in (float("nan"), float("inf"))),
    (pictures_of, {"a": torch.ones(0, 2, 3)}),
    (pictures_of, {"a": torch.ones(1, 8193, 3)}),
]


@pytest.mark.parametrize(("check", "value", "expected"), RIGHT)
def test_what_is_right_is_taken(check, value, expected):
    assert check("mine", value) == expected


@pytest.mark.parametrize(("check", "value"), WRONG)
def test_anything_else_is_an_error_of_one_line_that_names_the_plug_in(check, value):
    with pytest.raises(MethodError, match="mine") as caught:
        check("mine", value)

    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


def test_a_pattern_and_pictures_are_taken_as_float32():
    assert pattern_of("mine", torch.ones(3, 2, dtype=torch.float64)).dtype == np.float32
    assert pictures_of("mine", {"a b-1": PICTURE.double()})["a b-1"].dtype == torch.float32


class Seen(View):
    """A sphere whose mask or points are spoilt."""

    name = "seen"


@pytest.mark.parametrize(
    ("mask", "points", "rule"),
    [
        (lambda m: m & False, lambda p: p, "shows no point"),
        (lambda m: m.float(), lambda p: p, "must return booleans"),
        (lambda m: m.flatten(), lambda p: p, "must return booleans"),
        (lambda m: m | True, lambda p: p, r"t needs components \(16,\) float32"),
        (lambda m: m, lambda p: p.each(lambda c: c.double()), "t needs components"),
        (lambda m: m, lambda p: p.each(lambda c: c * float("nan")), "t must be finite"),
    ],
)
def test_a_view_of_other_points_than_its_mask_is_refused(monkeypatch, mask, points, rule):
    monkeypatch.setattr(Seen, "mask", lambda self: mask(gb.view("sphere", resolution=4).mask()))
    monkeypatch.setattr(Seen, "points", lambda self: points(gb.view("sphere", resolution=4).points()))

    with pytest.raises(MethodError, match=rf"^seen\..*{rule}"):
        check_view(Seen())


def is_refused(view) -> bool:
    try:
        check_view(view)
    except MethodError:
        return True
    return False


def test_a_sound_view_is_taken(monkeypatch):
    monkeypatch.setattr(Seen, "mask", lambda self: gb.view("sphere", resolution=4).mask())
    monkeypatch.setattr(Seen, "points", lambda self: gb.view("sphere", resolution=5).points())

    assert not is_refused(gb.view("sphere", resolution=4))
    assert is_refused(Seen())
