"""Claims: the sentences of a paper as data."""

from collections.abc import Collection, Mapping
from pathlib import PurePath
from typing import Annotated, Any, ClassVar

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from glossbench.columns import CONDITIONS
from glossbench.options import Finite


def _to_tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def _to_list(value: Any) -> Any:
    return value if isinstance(value, list) else [value]


def _check_order(bounds: tuple[float | None, float | None]) -> tuple[float | None, float | None]:
    low, high = bounds
    if low is None and high is None:
        raise ValueError("must have a number for at least one bound")
    if low is not None and high is not None and low > high:
        raise ValueError("must be [low, high] with low at most high")
    return bounds


def _check_one_method(side: Any) -> Any:
    rule = "must be a method, or {method: {option: value}}; further keys may be light, material and view"
    if not isinstance(side, str | dict):
        raise ValueError(rule)
    if isinstance(side, dict):
        others = [key for key in side if key not in CONDITIONS]
        if len(others) > 1 and isinstance(side[others[0]], dict | None):
            raise ValueError(f"{rule}; options go inside: {{{others[0]}: {{{others[1]}: ...}}}}")
        if len(others) != 1 or not isinstance(side[others[0]], dict):
            raise ValueError(rule)
    return side


def _check_pair(bounds: Any) -> Any:
    if not isinstance(bounds, list | tuple) or len(bounds) != 2:
        raise ValueError("must be [low, high], with null for a missing bound")
    return tuple(bounds)


Bounds = Annotated[tuple[Finite | None, Finite | None], AfterValidator(_check_order), BeforeValidator(_check_pair)]
Name = Annotated[str, Field(min_length=1)]
MARGIN = 0.01  # a ratio of two errors that differs less from 1 does not matter, even if it is real
# A method, or {method: {option: value, ...}} for those of its cells that have these values. The same mapping may also
# state a light, material or view, as in `where`: then only cells with that one are meant.
Side = Annotated[str | dict[Name, Any], BeforeValidator(_check_one_method)]
Names = Annotated[list[Name], BeforeValidator(_to_list, json_schema_input_type=Name | list[Name])]


class _Claim(BaseModel):
    """A sentence, and the cells that it is about.

    Attributes:
        text: the sentence, as the report prints it.
        where: light, material, view or the name of an option -> the value, or list of values, that cells must have. A
            light, material or view is stated by its name, or as {name: {option: value}}.
        by: options of the methods whose values are readings of the sentence: the summary says under which it holds.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)
    kind: ClassVar[str]
    text: Name
    where: dict[str, Any] = {}
    by: Names = []


class LowerClaim(_Claim):
    """|metric| of one side is below that of another, for every light, material, view and pairing option.

    Within the margin the two are equal: so small a difference does not matter, even if it is real.

    Normally both sides are compared under the same light, material and view. If a side states one of these, that one
    may differ between the sides.

    Attributes:
        lower: the side whose metric is below: a method, or {method: {option: value}}.
        than: the other side.
        metric: the error that is compared.
        paired_by: cells are compared at equal values of these options; by default those of `where`, and the budget.
        margin: half-width of the interval around the ratio 1 in which the sides are equal, in [0, 1).
    """

    kind: ClassVar[str] = "lower"
    lower: Side
    than: Side
    metric: Name
    paired_by: Names = []
    margin: Annotated[float, Field(ge=0, lt=1)] = MARGIN


class SlopeClaim(_Claim):
    """The least-squares slope of log |metric or cost| over log option lies within bounds, for every curve.

    The option belongs to the method, or is a parameter of the light, material or view: "alpha", or in full
    "material.alpha".

    Attributes:
        slope: a method, or {method: {option: value}}.
        over: the option or parameter along the curve; it needs at least three values.
        metric: an error or a cost.
        between: [low, high] of the slope; null means no bound.
    """

    kind: ClassVar[str] = "slope"
    slope: Side
    over: Name
    metric: Name
    between: Bounds


class RatioClaim(_Claim):
    """A column of one side, divided by that of another, lies within bounds; pairs as in LowerClaim.

    Attributes:
        ratio: [side, side], the first divided by the second; each is a method, or {method: {option: value}}.
        of: an error or a cost.
        between: [low, high] of the ratio; null means no bound.
        paired_by: cells are compared at equal values of these options; by default those of `where`, and the budget.
    """

    kind: ClassVar[str] = "ratio"
    ratio: Annotated[tuple[Side, Side], BeforeValidator(_to_tuple)]
    of: Name
    between: Bounds
    paired_by: Names = []


class ValueClaim(_Claim):
    """A column of a method lies within bounds, or equals a number, in every cell.

    Attributes:
        value: a method, or {method: {option: value}}.
        of: an error or a cost.
        between: [low, high]; null means no bound.
        equals: the number, compared to 9 digits.
    """

    kind: ClassVar[str] = "value"
    value: Side
    of: Name
    between: Bounds | None = None
    equals: Finite | None = None

    @model_validator(mode="after")
    def _check_one_bound(self) -> "ValueClaim":
        if (self.between is None) == (self.equals is None):
            raise ValueError("needs either 'between' or 'equals'")
        return self


Claim = LowerClaim | SlopeClaim | RatioClaim | ValueClaim
KINDS: dict[str, type[Claim]] = {c.kind: c for c in (LowerClaim, SlopeClaim, RatioClaim, ValueClaim)}


def read_claims(study: Mapping[str, Any]) -> list[Claim]:
    """The claims of a resolved study."""
    return [KINDS[kind].model_validate(claim) for claim in study["claims"] for kind in KINDS if kind in claim]


def list_sides(claim: Claim) -> dict[tuple[str | int, ...], Side]:
    """The one or two sides of a claim, by the path of the key that states each."""
    match claim:
        case LowerClaim():
            return {("lower",): claim.lower, ("than",): claim.than}
        case RatioClaim():
            return {("ratio", i): side for i, side in enumerate(claim.ratio)}
        case SlopeClaim():
            return {("slope",): claim.slope}
        case ValueClaim():
            return {("value",): claim.value}


def get_method(side: Side) -> str:
    """The method of a side."""
    return side if isinstance(side, str) else next(key for key in side if key not in CONDITIONS)


def get_options(side: Side) -> dict[str, Any]:
    """The options, with their values, that a side asks for."""
    return {} if isinstance(side, str) else side[get_method(side)]


def get_places(side: Side) -> dict[str, Any]:
    """The light, material and view that a side states; only those that it states."""
    return {} if isinstance(side, str) else {key: value for key, value in side.items() if key in CONDITIONS}


def list_methods(claim: Claim) -> set[str]:
    """The methods that a claim names."""
    return {get_method(side) for side in list_sides(claim).values()}


SEED = "seed"  # the option that seeds random points, in all methods
BUDGET = ""  # a pairing option that stands for the budget of each side, where the two budgets have different names


def find_pairing(
    claim: LowerClaim | RatioClaim, shared: Collection[str], budgets: Collection[str]
) -> tuple[list[str], list[str]]:
    """The options, and which of light, material and view, that must be equal in two cells to compare them.

    Args:
        shared: the options that both methods have.
        budgets: the options that are the budgets of both methods, each once; "" for a method without a budget.
    """
    apart = {key for side in list_sides(claim).values() for key in get_options(side)}
    own = [*budgets] if len(budgets) == 1 else [BUDGET]
    equal = own if "" not in budgets and not apart.intersection(budgets) else []
    usual = [
        key for key in dict.fromkeys([*claim.where, *equal]) if key == BUDGET or (key in shared and key not in apart)
    ]
    stated = {place for side in list_sides(claim).values() for place in get_places(side)}
    return claim.paired_by or usual, [place for place in CONDITIONS if place not in stated]


def agrees(wanted: Any, actual: Any) -> bool:
    """Whether a value fits the wanted one: they are equal, or it is in the wanted list, or all its components fit.

    {tune: metric} agrees with every option that was tuned by this metric, whatever the range.
    """
    if isinstance(wanted, dict) and isinstance(actual, dict):
        return all(key in actual and agrees(value, actual[key]) for key, value in wanted.items())
    if isinstance(actual, list) and not isinstance(wanted, list):
        return bool(actual) and all(agrees(wanted, component) for component in actual)
    if isinstance(wanted, list) and not isinstance(actual, list):
        return any(agrees(one, actual) for one in wanted if not isinstance(one, list))
    if isinstance(wanted, list):
        alike = len(wanted) == len(actual) and all(agrees(w, a) for w, a in zip(wanted, actual, strict=True))
        return alike or any(isinstance(one, list) and agrees(one, actual) for one in wanted)
    return bool(wanted == actual) and isinstance(wanted, bool) == isinstance(actual, bool)


def list_names(name: str, options: Mapping[str, Any]) -> set[str]:
    """The names of a light, material or view in `where` and `exclude`: its name, and for an image also its file."""
    file = options.get("file") if name == "file" else None
    return {name, file, PurePath(file).name} if isinstance(file, str) else {name}
