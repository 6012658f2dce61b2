"""Arguments as tensors and a form, and back."""

import pickle
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import pytest
import torch

from glossbench.directions import Vec3
from glossbench.scene.points import Occluder
from glossbench.shading.kernels.arguments import NotFlat, classes_of, flatten, has_scene, rebuild, scene_in, text_of


class Pair(NamedTuple):
    first: object
    second: object


@dataclass(frozen=True)
class Record:
    value: object
    name: str = "a"

    @cached_property
    def twice(self):
        return 2 * self.value


@dataclass(frozen=True)
class Checked:
    value: object

    def __post_init__(self):
        raise ValueError("made again")


ONE, TWO = torch.tensor(1.0), torch.tensor([2.0, 3.0])


@pytest.mark.parametrize(
    "value",
    [
        ONE,
        None,
        (None, True, 3, 0.5, "text"),
        (),
        [ONE, (TWO,)],
        Pair(ONE, None),
        Record(Pair(Vec3(ONE, TWO, ONE), (TWO,)), "b"),
    ],
)
def test_a_value_comes_back(value):
    form, tensors = flatten(value)

    back = rebuild(form, tensors)

    assert back == value
    assert type(back) is type(value)


def test_the_tensors_come_in_their_order():
    _, tensors = flatten((Record(ONE), Pair(TWO, [ONE])))

    assert [t is expected for t, expected in zip(tensors, (ONE, TWO, ONE), strict=True)] == [True] * 3


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (1, 1.0),
        (1, True),
        (None, "None"),
        ((ONE,), [ONE]),
        (Pair(ONE, None), (ONE, None)),
        (Record(ONE), Record(ONE, "b")),
        (Record(ONE), Record(None)),
    ],
)
def test_values_of_other_types_have_other_forms(one, other):
    forms = [flatten(value)[0] for value in (one, other)]

    assert forms[0] != forms[1]
    assert text_of(forms[0]) != text_of(forms[1])


def test_other_tensors_have_the_same_form():
    assert flatten(Record(ONE))[0] == flatten(Record(TWO))[0]


def test_a_form_can_be_sent_to_another_process():
    form, _ = flatten(Record(Vec3(ONE, ONE, ONE)))

    assert pickle.loads(pickle.dumps(form)) == form


def test_what_a_class_computes_from_its_fields_is_left_out():
    record = Record(ONE)
    assert record.twice == 2

    back = rebuild(*flatten(record))

    assert "twice" not in vars(back)


def test_the_checks_of_a_class_are_not_repeated():
    made = object.__new__(Checked)
    object.__setattr__(made, "value", ONE)

    assert rebuild(*flatten(made)).value is ONE


@pytest.mark.parametrize("value", [{"a": ONE}, {ONE}, object(), (ONE, print), Record, torch.float32])
def test_other_values_are_refused(value):
    with pytest.raises(NotFlat):
        flatten(value)


def test_an_attribute_that_is_not_a_field_is_refused():
    record = Record(ONE)
    object.__setattr__(record, "hidden", TWO)

    with pytest.raises(NotFlat, match="not fields"):
        flatten(record)


def test_the_classes_of_a_form():
    assert list(classes_of(flatten(Record(Pair(ONE, 1)))[0])) == [Record, Pair]


def test_another_scene_takes_the_place_of_a_scene():
    scene, other = Occluder(), Occluder()
    form, tensors = flatten((Record(scene), ONE))

    assert has_scene(form)
    assert scene_in((ONE, Record(scene))) is scene
    assert rebuild(form, tensors, other)[0].value is other
    assert not has_scene(flatten((ONE, Record(ONE)))[0])
    assert scene_in((ONE, Record(ONE))) is None
