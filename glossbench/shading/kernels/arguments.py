"""The arguments of a kernel as a list of tensors and a form: what is left when every tensor is taken out.

A form is a nested tuple that can be compared, hashed, written as text and pickled:

("tensor",)
("value", type, value)             None, a truth value, a number or a text
("tuple", class, forms)            a tuple, a named tuple or a list
("object", class, names, forms)    a dataclass and its fields
("scene",)                         a scene that hides light
"""

from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass
from functools import cache, cached_property
from typing import Any

from torch import Tensor

from glossbench.scene.points import Occluder

Form = tuple[Any, ...]
TENSOR: Form = ("tensor",)
SCENE: Form = ("scene",)


class NotFlat(TypeError):
    """An argument is neither a tensor, a number, a text nor None, nor made of these."""


def flatten(value: Any) -> tuple[Form, list[Tensor]]:
    """The form of a value and its tensors, in order.

    Raises:
        NotFlat: a part of the value is of another type.
    """
    tensors: list[Tensor] = []
    return _form(value, tensors), tensors


def rebuild(form: Form, tensors: Sequence[Tensor], scene: Occluder | None = None) -> Any:
    """The value of a form and its tensors. The checks that its classes make at their construction are not repeated.

    Args:
        scene: what takes the place of a scene.
    """
    return _value(form, iter(tensors), scene)


def has_scene(form: Form) -> bool:
    """Whether a scene is a part of a form."""
    return form == SCENE or (form[0] in ("tuple", "object") and any(map(has_scene, form[-1])))


def scene_in(value: Any) -> Occluder | None:
    """The first scene in a value."""
    if isinstance(value, Occluder):
        return value
    parts = value if isinstance(value, tuple | list) else vars(value).values() if is_dataclass(value) else ()
    return next((found for found in map(scene_in, parts) if found is not None), None)


def classes_of(form: Form) -> Iterator[type]:
    """The classes of all tuples and dataclasses in a form."""
    if form[0] in ("tuple", "object"):
        yield form[1]
        for part in form[-1]:
            yield from classes_of(part)


def text_of(form: Form) -> str:
    """A form as text, equal in every process."""
    if form[0] in ("tuple", "object"):
        name = f"{form[1].__module__}.{form[1].__qualname__}"
        return f"{name}{form[2:-1]}({', '.join(map(text_of, form[-1]))})"
    return "/".join(map(repr, form))


def _form(value: Any, tensors: list[Tensor]) -> Form:
    if isinstance(value, Tensor):
        tensors.append(value)
        return TENSOR
    if isinstance(value, Occluder):
        return SCENE
    if value is None or isinstance(value, bool | int | float | str):
        return "value", type(value).__name__, value
    if isinstance(value, tuple | list):
        return "tuple", type(value), tuple([_form(part, tensors) for part in value])
    if is_dataclass(value) and not isinstance(value, type):
        names = _names(type(value))
        if any(name not in names and not _is_derived(type(value), name) for name in vars(value)):
            raise NotFlat(f"{type(value).__name__} has attributes that are not fields")
        return "object", type(value), names, tuple([_form(getattr(value, name), tensors) for name in names])
    raise NotFlat(f"{type(value).__name__} is not made of tensors")


@cache
def _names(cls: Any) -> tuple[str, ...]:
    return tuple(each.name for each in fields(cls))


def _is_derived(cls: type, name: str) -> bool:
    """Whether an attribute is computed from the others at its first use."""
    return isinstance(getattr(cls, name, None), cached_property)


def _value(form: Form, tensors: Iterator[Tensor], scene: Occluder | None) -> Any:
    kind = form[0]
    if kind == "tensor":
        return next(tensors)
    if kind == "value":
        return form[2]
    if kind == "scene":
        return scene
    parts = [_value(part, tensors, scene) for part in form[-1]]
    if kind == "tuple":
        return form[1](*parts) if hasattr(form[1], "_fields") else form[1](parts)
    made = object.__new__(form[1])
    for name, part in zip(form[2], parts, strict=True):
        object.__setattr__(made, name, part)
    return made
