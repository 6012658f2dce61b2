"""Claims: a paper's sentences as data."""

from collections.abc import Collection, Mapping
from pathlib import PurePath
from typing import Annotated, Any, ClassVar

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from glossbench.errors import nearest
from glossbench.options import Finite

COLUMNS = (
    "n_samples",
    "shade_seconds",
    "state_bytes",
    "stage_seconds",
)  # costs; those of stages are added up
PLACES = ("light", "material", "view")


def _tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def _listed(value: Any) -> Any:
    return value if isinstance(value, list) else [value]


def _ordered(bounds: tuple[float | None, float | None]) -> tuple[float | None, float | None]:
    low, high = bounds
    if low is None and high is None:
        raise ValueError("must have a number for at least one bound")
    if low is not None and high is not None and low > high:
        raise ValueError("must be [low, high] with low at most high")
    return bounds


Bounds = Annotated[tuple[Finite | None, Finite | None], AfterValidator(_ordered), BeforeValidator(_tuple)]
Name = Annotated[str, Field(min_length=1)]
Names = Annotated[list[Name], BeforeValidator(_listed, json_schema_input_type=Name | list[Name])]


class _Claim(BaseModel):
    """A sentence, and the cells that it is about.

    Attributes:
        text: the sentence, as the report prints it.
        where: light, material, view or an option's name -> the value, or the values, that cells must have.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)
    kind: ClassVar[str]
    text: Name
    where: dict[str, Any] = {}


class LowerClaim(_Claim):
    """|metric| of one method is below that of another, for every light, material, view and pairing option."""

    kind: ClassVar[str] = "lower"
    lower: Name
    than: Name
    metric: Name
    paired_by: Names = []


class SlopeClaim(_Claim):
    """The least-squares slope of log |metric| over log option lies within bounds, for every curve."""

    kind: ClassVar[str] = "slope"
    slope: Name
    over: Name
    metric: Name
    between: Bounds


class RatioClaim(_Claim):
    """A column of one method over that of another lies within bounds; pairs as in LowerClaim."""

    kind: ClassVar[str] = "ratio"
    ratio: Annotated[tuple[Name, Name], BeforeValidator(_tuple)]
    of: Name
    between: Bounds
    paired_by: Names = []


class ValueClaim(_Claim):
    """A column of a method lies within bounds, or equals a number, in every cell."""

    kind: ClassVar[str] = "value"
    value: Name
    of: Name
    between: Bounds | None = None
    equals: Finite | None = None

    @model_validator(mode="after")
    def _one_bound(self) -> "ValueClaim":
        if (self.between is None) == (self.equals is None):
            raise ValueError("needs either 'between' or 'equals'")
        return self


Claim = LowerClaim | SlopeClaim | RatioClaim | ValueClaim
KINDS: dict[str, type[Claim]] = {c.kind: c for c in (LowerClaim, SlopeClaim, RatioClaim, ValueClaim)}


def methods_of(claim: Claim) -> dict[tuple[str | int, ...], str]:
    """The methods that a claim names, by the path of the key that names them."""
    match claim:
        case LowerClaim():
            return {("lower",): claim.lower, ("than",): claim.than}
        case RatioClaim():
            return {("ratio", i): name for i, name in enumerate(claim.ratio)}
        case SlopeClaim():
            return {("slope",): claim.slope}
        case ValueClaim():
            return {("value",): claim.value}


def unknown_name(
    claim: Claim, methods: Mapping[str, Collection[str]], places: Mapping[str, Collection[str]],
    material_options: Collection[str], metrics: Collection[str],
) -> tuple[tuple[str | int, ...], str] | None:  # fmt: skip
    """The first name in a claim that its study does not have: the path of its key, and the message.

    Args:
        methods: the study's methods with the names of their options.
        places: the names that light, material and view each answer to; what is left out is not checked.
        material_options: options of the study's materials.
        metrics: the study's metrics.
    """
    named = methods_of(claim)
    for path, name in named.items():
        if name not in methods:
            return path, f"no method {name!r} in this study{nearest(name, methods)}"
    options = [set(methods[name]) for name in named.values()]
    shared = set.intersection(*options)
    wanted: list[tuple[str, str, str, Collection[str]]] = []  # key, what, name, known
    if isinstance(claim, LowerClaim | SlopeClaim):
        wanted.append(("metric", "metric", claim.metric, metrics))
    if isinstance(claim, RatioClaim | ValueClaim):
        wanted.append(("of", "column", claim.of, [*metrics, *COLUMNS]))
    if isinstance(claim, SlopeClaim):
        wanted.append(("over", f"option of {claim.slope}", claim.over, shared))
    if isinstance(claim, LowerClaim | RatioClaim):
        wanted += [("paired_by", "option of both methods", name, shared) for name in claim.paired_by]
    for key, what, name, known in wanted:
        if name not in known:
            return (key,), f"no {what} {name!r} in this study{nearest(name, known)}"
    restrictable = {*PLACES, *material_options, *set.union(*options)}
    for key, value in claim.where.items():
        if key not in restrictable:
            text = f"no option {key!r} of its methods or materials{nearest(key, restrictable)}"
            return ("where", key), text
        for name in _listed(value):
            if key in places and name not in places[key]:
                return ("where", key), f"no {key} {name!r} in this study{nearest(str(name), places[key])}"
    return None


def agrees(wanted: Any, actual: Any) -> bool:
    """Whether an option has the value wanted: equal, one of a list, or a scalar that all components equal."""
    if isinstance(actual, list) and not isinstance(wanted, list):
        return bool(actual) and all(agrees(wanted, component) for component in actual)
    if isinstance(wanted, list) and not isinstance(actual, list):
        return any(agrees(one, actual) for one in wanted if not isinstance(one, list))
    if isinstance(wanted, list):
        alike = len(wanted) == len(actual) and all(agrees(w, a) for w, a in zip(wanted, actual, strict=True))
        return alike or any(isinstance(one, list) and agrees(one, actual) for one in wanted)
    return bool(wanted == actual) and isinstance(wanted, bool) == isinstance(actual, bool)


def called(name: str, options: Mapping[str, Any]) -> set[str]:
    """What a light, material or view answers to in `where` and `exclude`: its name; an image's file, too."""
    file = options.get("file") if name == "file" else None
    return {name, file, PurePath(file).name} if isinstance(file, str) else {name}
