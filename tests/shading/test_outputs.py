"""Return values of plug-ins other than radiance: valid ones are used, any other is an error of the plug-in."""

import numpy as np
import pytest
import torch

import glossbench as gb
from glossbench.errors import MethodError
from glossbench.scene.points import View
from glossbench.shading.outputs import (
    check_count,
    check_key,
    check_notes,
    check_number,
    check_pattern,
    check_pictures,
    check_reason,
    check_view,
)

RIGHT = [
    (check_reason, None, None),
    (check_reason, "only round lobes", "only round lobes"),
    (check_count, 0, 0),
    (check_count, np.int32(7), 7),
    (check_count, torch.tensor(7), 7),
    (check_notes, [], []),
    (check_notes, ("a", "b"), ["a", "b"]),
    (check_notes, ("\ud800",), ["\\ud800"]),
    (check_number, 1, 1.0),
    (check_number, np.float32(0.5), 0.5),
    (check_number, torch.tensor(0.5), 0.5),
    (check_number, float("inf"), float("inf")),
    (check_key, "a", "a"),
    (check_pattern, None, None),
    (check_pictures, {}, {}),
]
PICTURE = torch.ones(2, 3, 3)
WRONG = [
    *((check_reason, value) for value in ("", " \n", True, False)),
    *((check_count, value) for value in (-1, 10**30, 1.5, "7", None, True, torch.ones(2), float("nan"))),
    *((check_notes, value) for value in ("a sentence", None, [1], {"a": 1}, 7)),
    *((check_number, value) for value in (float("nan"), "1", None, 10**400, 1j, True, [1.0], torch.ones(2))),
    *((check_key, value) for value in (None, 7, b"a")),
    *((check_pattern, value) for value in (torch.ones(5), torch.ones(5, 3), np.ones((5, 2)), [[1, 2]], 7)),
    (check_pattern, torch.full((5, 2), float("nan"))),
    (check_pattern, torch.ones(5, 2) + 0j),
    *((check_pictures, value) for value in (None, [PICTURE], PICTURE)),
    *((check_pictures, {name: PICTURE}) for name in ("a/b", "", "..", ".a", "a\n", "a" * 81, 7, "é")),
    *((check_pictures, {"a": value}) for value in (torch.ones(2, 2), torch.ones(2, 2, 4), np.ones((2, 2, 3)), None)),
    *((check_pictures, {"a": torch.full((2, 2, 3), value)}) for value in (float("nan"), float("inf"))),
    (check_pictures, {"a": torch.ones(0, 2, 3)}),
    (check_pictures, {"a": torch.ones(1, 8193, 3)}),
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
    assert check_pattern("mine", torch.ones(3, 2, dtype=torch.float64)).dtype == np.float32
    assert check_pictures("mine", {"a b-1": PICTURE.double()})["a b-1"].dtype == torch.float32


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
        (lambda m: m, lambda p: p.map(lambda c: c.double()), "t needs components"),
        (lambda m: m, lambda p: p.map(lambda c: c * float("nan")), "t must be finite"),
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
