"""Sweeps: expand an item of a study, with its lists, zip and tune, to its variants."""

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, fields
from itertools import product
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from glossbench.catalog.locate import locate
from glossbench.errors import InputError, suggest_nearest
from glossbench.metrics import METRICS, Metric
from glossbench.options import Options, check, list_options, make_option_schema
from glossbench.plugin_errors import locate_error, summarize_error
from glossbench.rules import suggest_instead
from glossbench.shading.method import Method
from glossbench.study.cells import Candidate, Tuning
from glossbench.study.document import Document, KeyPath, format_path
from glossbench.study.item_words import WORDS, explain_unknown, format_flow
from glossbench.study.registries import REGISTRIES
from glossbench.study.schema import TuneKeys


class Axis(NamedTuple):
    """Options that vary together, and the values that they take."""

    options: tuple[str, ...]
    values: list[tuple[Any, ...]]


class Form:
    """An item as the file states it: a class, the axes of its sweeps, a tuned option.

    Args:
        folder: the folder of the study; files that the item names may lie there.
        seed: the seed of the study, for a method that has an option `seed` and does not state it.
        metrics: the metrics of the study, by column; a method may be tuned by one of them, or by any other metric.
    """

    def __init__(
        self,
        document: Document,
        kind: str,
        path: KeyPath,
        value: Any,
        folder: Path,
        seed: int,
        metrics: Mapping[str, Metric] = MappingProxyType({}),
    ) -> None:
        self._document, self._kind, self._folder, self._metrics = document, kind, folder, metrics
        name, stated, self.path, at = self._read_name(path, value)
        if name not in REGISTRIES[kind.removesuffix("s")].names():
            text = f"{format_path(path)}: {explain_unknown(self.noun, name, stated)}"
            raise document.make_error(at, text, at_key=at != path)
        self.cls: type[Options] = REGISTRIES[kind.removesuffix("s")].get(name)
        self.tune: Tuning | None = None
        self.axes: list[Axis] = []
        if not isinstance(stated, dict):
            of_file = [option for option in list_options(self.cls) if self.cls.file_of(option, str(stated))]
            hint = "".join(f"; write {name}: {format_flow({option: stated})}" for option in of_file[:1])
            raise document.make_error(at, f"{format_path(at)}: options must be a mapping, got {stated!r}{hint}")
        self._stated = stated
        self._require_known(self.path, [option for option in stated if option != "zip"])
        for option, given in stated.items():
            self._add(option, given)
        options = [option for axis in self.axes for option in axis.options]
        options += [self.tune.option] if self.tune else []
        twice = next((option for option in options if options.count(option) > 1), None)
        if twice:
            text = f"{format_path(self.path)}: {twice!r} is in 'zip', too"
            raise document.make_error((*self.path, twice), text, at_key=True)
        self._follows_seed = kind == "methods" and "seed" in set(list_options(self.cls)) - set(options)
        self._start: dict[str, Any] = {"seed": seed} if self._follows_seed else {}
        if self.tune and not _has_default(self.cls, self.tune.option):
            self._start[self.tune.option] = self.tune.low

    @property
    def noun(self) -> str:
        """What one variant is: a light, material, view, method or metric."""
        return self._kind.removesuffix("s")

    def count_variants(self) -> int:
        return math.prod(len(axis.values) for axis in self.axes)

    def expand(self) -> Iterator[Any]:
        """The items that the form stands for; the last axis varies fastest."""
        for values in product(*(axis.values for axis in self.axes)):
            options = dict(self._start)
            for axis, of_axis in zip(self.axes, values, strict=True):
                options |= dict(zip(axis.options, of_axis, strict=True))
            try:
                made = self.cls.create(options)
                json.dumps(made.as_dict())  # a plug-in's own as_dict may return data that JSON cannot hold
            except ValueError as error:
                text = str(error).removeprefix(self.cls.name)
                text = f": {text}" if text == str(error) else text
                raise self._document.make_error(self.path, f"{format_path(self.path)}{text}") from error
            except (Exception, SystemExit) as error:  # raised by a plug-in's constructor
                place = f" ({found})" if (found := locate_error(error)) else ""
                text = f"{format_path(self.path)} cannot be made: {summarize_error(error)}{place}"
                raise self._document.make_error(self.path, text) from error
            yield Candidate(made, self.tune, self._follows_seed) if isinstance(made, Method) else made

    def open_files(self) -> None:
        """Read all files that the items name.

        Raises:
            InputError: a file cannot be read, or its contents are wrong; the position is that of the file's name.
        """
        for item in self.expand():
            made = item.method if isinstance(item, Candidate) else item
            files = {o: v for o, v in made.as_dict().items() if isinstance(v, str) and self.cls.file_of(o, v)}
            for option, file in list(files.items())[:1]:
                try:
                    made.open_files()
                except InputError as error:
                    path = self._find_path(option, file)
                    raise self._document.make_error(path, f"{format_path(path)}: {error}") from error

    def _find_path(self, option: str, file: str) -> KeyPath:
        """The path of the value that names a file."""
        given = self._stated.get(option)
        listed = given if isinstance(given, list) else []
        at = [i for i, each in enumerate(listed) if isinstance(each, str) and file.endswith(each)]
        return (*self.path, option, *at[:1])

    def _read_name(self, path: KeyPath, value: Any) -> tuple[str, Any, KeyPath, KeyPath]:
        """(name, options, path of the options, path of the name)."""
        if isinstance(value, str):
            name, options = WORDS[self._kind](value) if self._kind in WORDS else (value, {})
            return name, options, path, path
        if isinstance(value, dict) and self._kind == "light" and "file" in value:
            if len(value) > 1 or not isinstance(value["file"], dict | None):
                return "file", value, path, path
        if not isinstance(value, dict) or len(value) != 1:
            got = f"the keys {', '.join(map(repr, value))}" if isinstance(value, dict) else repr(value)
            text = f"{format_path(path)} must be a name, or one name with its options below it, got {got}"
            raise self._document.make_error(path, text + self._suggest_keys(value))
        [(name, options)] = value.items()
        options = {} if options is None else options
        meant, more = WORDS[self._kind](name) if self._kind in WORDS else (name, {})
        if more and isinstance(options, dict):
            name, options = meant, {**more, **options}
        return name, options, (*path, next(iter(value))), (*path, next(iter(value)))

    def _suggest_keys(self, value: Any) -> str:
        """What to write instead of several keys: options must be indented deeper, and items must begin with a dash."""
        names = REGISTRIES[self.noun].names()
        if not isinstance(value, dict) or next(iter(value), None) not in names:
            return ""
        first, *others = value
        if all(other in names for other in others):
            return f"; begin each {self.noun} with a dash"
        options = [*list_options(REGISTRIES[self.noun].get(first)), "zip"]
        inside = next((other for other in others if other in options), None)
        return f"; indent {inside!r} deeper than {first!r}" if inside else ""

    def _add(self, option: str, given: Any) -> None:
        path = (*self.path, option)
        if option == "zip":
            self.axes.append(self._zip_options(path, given))
            return
        if isinstance(given, dict) and "tune" in given:
            self.tune = self._read_tune(path, option)
            return
        if self._accepts(option, given) or not self._is_sweep(option, given):
            values = [self._check_value(path, option, given)]
        else:
            values = self._check_each(path, option, given)
        self.axes.append(Axis((option,), [(value,) for value in values]))

    def _takes_fractions(self, option: str) -> bool:
        """Whether its values are numbers that need not be whole: a search tries values between the ends of a range."""
        stated = make_option_schema(self.cls, option)
        return any(branch.get("type") == "number" for branch in (stated, *stated.get("anyOf", [])))

    def _is_sweep(self, option: str, given: Any) -> bool:
        """Whether a rejected value is a sweep: a list; for an option of lists, a list of lists."""
        of_any_length = "items" in make_option_schema(self.cls, option)
        return isinstance(given, list) and (not of_any_length or any(isinstance(value, list) for value in given))

    def _accepts(self, option: str, value: Any) -> bool:
        try:
            check(self.cls, option, value)
        except InputError:
            return False
        return True

    def _check_value(self, path: KeyPath, option: str, value: Any) -> Any:
        """The value, which the option must accept; a file that lies in the study's folder becomes its whole path."""
        try:
            check(self.cls, option, value)
        except InputError as error:
            rule = str(error).removeprefix(f"{self.cls.name}.{option}")
            rule += suggest_instead(rule, value)
            if isinstance(value, dict) and self._kind == "methods":
                rule += "; to tune it write {tune: METRIC, range: [low, high]} in place of its whole value"
            raise self._document.make_error(path, f"{format_path(path)}{rule}") from error
        kind = self.cls.file_of(option, value) if isinstance(value, str) else None
        if kind is None:
            return value
        try:
            found = locate(value, self._folder, kind)
        except InputError as error:
            raise self._document.make_error(path, f"{format_path(path)}: {error}") from error
        return str(found) if found == self._folder / value else value

    def _check_each(self, path: KeyPath, option: str, values: list[Any]) -> list[Any]:
        if not values:
            raise self._document.make_error(path, f"{format_path(path)} sweeps an empty list")
        return [self._check_value((*path, i), option, value) for i, value in enumerate(values)]

    def _zip_options(self, path: KeyPath, given: Any) -> Axis:
        if not isinstance(given, dict) or not given or not all(isinstance(v, list) for v in given.values()):
            raise self._document.make_error(path, f"{format_path(path)} must map options to lists, got {given!r}")
        self._require_known(path, list(given))
        lengths = [len(values) for values in given.values()]
        if len(set(lengths)) > 1:
            told = ", ".join(f"{option} has {n}" for option, n in zip(given, lengths, strict=True))
            raise self._document.make_error(path, f"{format_path(path)} pairs lists of equal length, but {told}")
        columns = [self._check_each((*path, option), option, values) for option, values in given.items()]
        return Axis(tuple(given), list(zip(*columns, strict=True)))

    def _read_tune(self, path: KeyPath, option: str) -> Tuning:
        where = format_path(path)
        if self._kind != "methods" or self.tune is not None:
            why = "only one option of an item" if self._kind == "methods" else "only an option of a method"
            raise self._document.make_error(path, f"{where}: {why} can be tuned")
        model = self._document.validate(TuneKeys, path)
        if not self._takes_fractions(option):
            text = f"{where}: only an option that takes fractions can be tuned; sweep this one: a list of its values"
            raise self._document.make_error(path, text)
        if problem := self._explain_metric(model.tune):
            raise self._document.make_error((*path, "tune"), f"{where}.tune: {problem}")
        metric = self._metrics.get(model.tune) or METRICS.get(model.tune)
        if not metric.lower_is_better:
            text = f"{where}.tune: {model.tune} is higher for better images; tune an error"
            raise self._document.make_error((*path, "tune"), text)
        bounds = model.range or _read_bounds(self.cls, option)
        if bounds is None:
            text = f"{where} has no bounds to tune between; state range: [low, high]"
            raise self._document.make_error(path, text)
        low, high = map(float, bounds)
        if not low < high:
            raise self._document.make_error(
                (*path, "range"), f"{where}.range must be [low, high], low first, got {bounds}"
            )
        for value in (low, high):
            self._check_value((*path, "range"), option, value)
        return Tuning(option, model.tune, low, high)

    def _explain_metric(self, name: str) -> str:
        """The message for a name that is unknown, or shared by several metrics of the study; "" for a valid name."""
        same = [column for column in self._metrics if column.startswith(f"{name} (")]
        if name in self._metrics or (name in METRICS.names() and not same):
            return ""
        if same:
            return f"{name!r} may mean {' or '.join(map(repr, same))}: say which"
        return f"unknown metric {name!r}{suggest_nearest(name, [*self._metrics, *METRICS.names()])}"

    def _require_known(self, path: KeyPath, options: list[str]) -> None:
        known = list_options(self.cls)
        if unknown := [option for option in options if option not in known]:
            raise self._document.make_unknown_error(path, "option", unknown, known)


def _read_bounds(cls: type[Options], option: str) -> list[float] | None:
    """The inclusive bounds in the annotation of a number, or None."""
    stated = make_option_schema(cls, option)
    for branch in (stated, *stated.get("anyOf", [])):
        if "minimum" in branch and "maximum" in branch:
            return [branch["minimum"], branch["maximum"]]
    return None


def _has_default(cls: type[Options], option: str) -> bool:
    stated = next(f for f in fields(cls) if f.name == option)  # type: ignore[arg-type]
    return stated.default is not MISSING or stated.default_factory is not MISSING
