"""Options: frozen dataclasses whose annotations state the bounds. Values from YAML and Python get the same checks."""

import dataclasses
import json
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Self, TypeVar, dataclass_transform, get_type_hints

from pydantic import AfterValidator, BeforeValidator, Field, TypeAdapter, ValidationError

from glossbench.errors import InputError, suggest_nearest
from glossbench.memory import check_memory
from glossbench.rules import state_rule


def _spread(n: int) -> Any:
    """A scalar stands for n equal components."""
    return BeforeValidator(lambda v: (v,) * n if isinstance(v, int | float) and not isinstance(v, bool) else v)


def _check_power_of_two(n: int) -> int:
    if n & (n - 1):
        raise ValueError("must be a power of two")
    # Measured bytes per texel: 38 (constant) to 87 (sky) while a light is made. Methods allocate theirs later, when the
    # light holds only 12.
    check_memory(f"a cube of 6 x {n} x {n} texels", 90 * 6 * n * n)
    return n


NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Fraction = Annotated[float, Field(ge=0, le=1)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Color = Annotated[tuple[Fraction, Fraction, Fraction], _spread(3)]  # reflectance, [0, 1]; a scalar is grey
Radiance = Annotated[tuple[NonNegative, NonNegative, NonNegative], _spread(3)]
Width = Annotated[float, Field(gt=0, le=1)]  # of a microfacet distribution
Widths = Annotated[tuple[Width, Width], _spread(2)]  # along t and b; a scalar is isotropic
Resolution = Annotated[
    int, Field(ge=2, le=8192), AfterValidator(_check_power_of_two)
]  # along the edge of a cube's face
Seed = Annotated[int, Field(ge=0, lt=1 << 32)]  # multiplied by replicates and points, it fits the generators' 64 bits


@dataclass_transform(frozen_default=True, kw_only_default=True)
class Options:
    """Base class of everything with options: each subclass becomes a frozen, keyword-only dataclass by itself.

    Each annotated attribute is an option; `Annotated[int, Field(ge=1)]` states a bound (pydantic's notation).
    A value of a wrong type, a value out of bounds or an unknown name raises InputError with one line.

    >>> class Blur(Options):
    ...     name = "blur"
    ...     width: Annotated[float, Field(gt=0, le=1)] = 0.5
    ...
    >>> Blur.create({"width": 0.1})
    Blur(width=0.1)
    >>> Blur(width=2)
    Traceback (most recent call last):
        ...
    glossbench.errors.InputError: blur.width must be less than or equal to 1, got 2
    >>> Blur.create({"widht": 0.1})
    Traceback (most recent call last):
        ...
    glossbench.errors.InputError: blur: unknown option 'widht'; did you mean 'width'?
    """

    name: ClassVar[str] = ""
    _checks: ClassVar[dict[str, TypeAdapter[Any]]]

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        dataclasses.dataclass(frozen=True, kw_only=True)(cls)

    def __post_init__(self) -> None:
        for option in dataclasses.fields(self):  # type: ignore[arg-type]
            object.__setattr__(self, option.name, check(type(self), option.name, getattr(self, option.name)))

    @classmethod
    def create(cls, options: Mapping[str, Any]) -> Self:
        """An instance from a mapping. Raises InputError for a missing name, and for an unknown one with the nearest."""
        known = list_options(cls)
        for key in options:
            if key not in known:
                raise InputError(f"{cls.name}: unknown option {key!r}{suggest_nearest(key, known)}")
        for option in dataclasses.fields(cls):  # type: ignore[arg-type]
            required = option.default is dataclasses.MISSING and option.default_factory is dataclasses.MISSING
            if required and option.name not in options:
                raise InputError(f"{cls.name}: option {option.name!r} is required")
        return cls(**options)

    def __reduce__(self) -> tuple[Any, ...]:
        # As `copy_of`: what was read from a file is not pickled.
        return type(self).create, (self.as_dict(),)

    def as_dict(self) -> dict[str, Any]:
        """All options with their values, as JSON types."""
        adapters = _make_adapters(type(self))
        return {key: adapter.dump_python(getattr(self, key), mode="json") for key, adapter in adapters.items()}

    def is_usual(self) -> bool:
        """Whether every option has its default."""
        return all(getattr(self, option.name) == option.default for option in dataclasses.fields(self))  # type: ignore[arg-type]

    def key(self) -> str:
        """Text that changes if the meaning of the options may change; a file counts by its bytes, not by its name."""
        return f"{self.name}:{json.dumps(self.as_dict(), sort_keys=True)}"

    @classmethod
    def file_of(cls, option: str, value: str) -> str | None:
        """The kind of file that a value of an option names ("image file"); None if the value does not name a file.

        A study looks for such a file also in its own folder, and `validate` opens it.
        """
        return None

    def open_files(self) -> None:
        """Read the files that these options name. Raises InputError if one cannot be read or has wrong contents."""

    def notes(self) -> tuple[str, ...]:
        """Sentences that a reader of its numbers must know: for example, repairs of a file, or the error of a fit."""
        return ()


T = TypeVar("T", bound=Options)


def copy_of(item: T) -> T:
    """Equal options in a new object, which has not read a file yet."""
    return type(item).create(item.as_dict())


def list_options(cls: type[Options]) -> tuple[str, ...]:
    """Names of the options of a class, in the order of its source."""
    return tuple(option.name for option in dataclasses.fields(cls))  # type: ignore[arg-type]


def check(cls: type[Options], option: str, value: Any) -> Any:
    """The value of one option, converted (list to tuple, scalar to vector), or InputError."""
    try:
        return _make_adapters(cls)[option].validate_python(value)
    except ValidationError as error:
        first = error.errors()[0]
        where = "".join(f"[{part}]" for part in first["loc"] if isinstance(part, int))
        within = first.get("ctx", {}).get("error")
        if isinstance(within, InputError):  # the option itself holds options
            raise InputError(f"{cls.name or cls.__name__}.{option}{where}: {within}") from None
        raise InputError(f"{cls.name or cls.__name__}.{option}{where} {state_rule(first)}") from None


def _make_adapters(cls: type[Options]) -> dict[str, TypeAdapter[Any]]:
    """The checks of all options, made once per class and stored in it."""
    if "_checks" not in vars(cls):
        hints = get_type_hints(cls, include_extras=True)
        # Strict, so that "40" and true are not accepted as numbers. Lists become tuples; this is the only conversion.
        annotated: dict[str, Any] = {
            key: Annotated[hints[key], BeforeValidator(_to_tuples)] for key in list_options(cls)
        }
        cls._checks = {key: TypeAdapter(hint, config={"strict": True}) for key, hint in annotated.items()}
    return cls._checks


def _to_tuples(value: Any) -> Any:
    return tuple(_to_tuples(v) for v in value) if isinstance(value, list) else value


def make_option_schema(cls: type[Options], option: str) -> dict[str, Any]:
    """JSON Schema of an option of a class, without its default."""
    return _make_adapters(cls)[option].json_schema()


def make_schema(cls: type[Options]) -> dict[str, Any]:
    """JSON Schema of the options of a class."""
    properties = {key: make_option_schema(cls, key) for key in _make_adapters(cls)}
    for option in dataclasses.fields(cls):  # type: ignore[arg-type]
        if option.default is not dataclasses.MISSING:
            properties[option.name]["default"] = _make_adapters(cls)[option.name].dump_python(
                option.default, mode="json"
            )
    return {"type": "object", "properties": properties, "additionalProperties": False}
