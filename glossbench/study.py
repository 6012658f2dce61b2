"""Studies: a YAML file -> a checked Study -> the cells to be run."""

import importlib
import json
import math
from collections.abc import Iterator
from dataclasses import MISSING, dataclass, field, fields, replace
from importlib import resources
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from glossbench.brdf.material import MATERIALS
from glossbench.claims import KINDS, PLACES, Claim, agrees, called, unknown_name
from glossbench.envmap.lights import LIGHTS, FileLight, locate
from glossbench.errors import InputError, nearest
from glossbench.ground_truth import FIRST_SAMPLES, N_REPLICATES
from glossbench.metrics import METRICS
from glossbench.options import Finite, Options, check, json_schema, option_names
from glossbench.registry import Registry
from glossbench.scene.points import VIEWS
from glossbench.shading import METHODS
from glossbench.yaml_marks import Document, KeyPath, path_text, read_document

MAX_CELLS = 100_000
REGISTRIES: dict[str, Registry[Any]] = {
    "light": LIGHTS,
    "material": MATERIALS,
    "view": VIEWS,
    "methods": METHODS,
}


@dataclass(frozen=True)
class Item:
    """A light, material or view by name, with all its options as JSON types."""

    name: str
    options: dict[str, Any] = field(hash=False)

    def spelled(self) -> dict[str, Any]:
        """The options as a study states them."""
        return dict(self.options)

    @property
    def json(self) -> str:
        """The options as canonical JSON: equal for equal items, whatever the order of keys."""
        return json.dumps(self.spelled(), sort_keys=True)


@dataclass(frozen=True)
class Tune:
    """One option of a method, to be set where a metric is lowest within [low, high]."""

    option: str
    metric: str
    low: float
    high: float


@dataclass(frozen=True)
class MethodItem(Item):
    """A method by name; a tuned option has its default in `options`, or the lowest value."""

    tune: Tune | None = None

    def spelled(self) -> dict[str, Any]:
        """The options as a study states them, a tuned one as {tune: metric, range: [low, high]}."""
        if self.tune is None:
            return dict(self.options)
        return {
            **self.options,
            self.tune.option: {"tune": self.tune.metric, "range": [self.tune.low, self.tune.high]},
        }


@dataclass(frozen=True)
class Cell:
    """One image to be made and measured."""

    light: Item
    material: Item
    view: Item
    method: MethodItem


class ReferenceOptions(BaseModel):
    """How the truth is computed.

    Attributes:
        relative_error: RMS of its standard error over its mean, at which it is good enough.
        seed: of its scrambles.
        max_samples: where it stops in any case, a pixel and technique.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)
    relative_error: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 1e-3
    seed: Annotated[int, Field(ge=0)] = 0
    max_samples: Annotated[int, Field(ge=N_REPLICATES * FIRST_SAMPLES)] = 1 << 16


def _listed(value: Any) -> Any:
    return value if isinstance(value, list) else [value]


Name = Annotated[str, Field(min_length=1)]
Names = Annotated[
    list[str], Field(min_length=1), BeforeValidator(_listed, json_schema_input_type=str | list[str])
]


class _StudyModel(BaseModel):
    """The keys of a study; what is in an item depends on its name."""

    model_config = ConfigDict(extra="forbid", strict=True)
    title: Name
    source: str = ""
    question: str = ""
    light: Any
    material: Any
    view: Any
    methods: Any
    reference: ReferenceOptions = ReferenceOptions()
    metrics: Names = ["rms", "relative_rms", "mean_error", "max_error"]
    claims: list[Any] = []
    exclude: list[dict[str, Any]] = []
    seed: Annotated[int, Field(ge=0)] = 0
    device: Literal["cpu", "cuda"] = "cpu"
    plugins: list[str] = []


class _TuneModel(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)
    tune: str
    range: Annotated[list[Finite], Field(min_length=2, max_length=2)] | None = None


@dataclass(frozen=True)
class Study:
    """A question, and all that is compared to answer it; the name of the file does not count in ==.

    Attributes:
        exclude: mappings of light, material, view, method or an option to a value; what fits is left out.
        name: of its file, without the ending.
        folder: of its file.
    """

    title: str
    source: str
    question: str
    lights: tuple[Item, ...]
    materials: tuple[Item, ...]
    views: tuple[Item, ...]
    methods: tuple[MethodItem, ...]
    reference: ReferenceOptions
    metrics: tuple[str, ...]
    claims: tuple[Claim, ...]
    exclude: tuple[dict[str, Any], ...]
    seed: int
    device: str
    plugins: tuple[str, ...]
    name: str = field(compare=False)
    folder: Path = field(compare=False)

    def cells(self) -> list[Cell]:
        """Every light x material x view x method in this order, but those excluded."""
        every = (Cell(*items) for items in product(self.lights, self.materials, self.views, self.methods))
        return [cell for cell in every if not any(_fits(cell, entry) for entry in self.exclude)]

    def resolved(self) -> dict[str, Any]:
        """The study as plain data, everything spelled out; its YAML loads as an equal study."""
        return {
            "title": self.title, "source": self.source, "question": self.question,
            "light": [{item.name: item.spelled()} for item in self.lights],
            "material": [{item.name: item.spelled()} for item in self.materials],
            "view": [{item.name: item.spelled()} for item in self.views],
            "methods": [{item.name: item.spelled()} for item in self.methods],
            "reference": self.reference.model_dump(),
            "metrics": list(self.metrics),
            "claims": [claim.model_dump(mode="json", exclude_none=True) for claim in self.claims],
            "exclude": [dict(entry) for entry in self.exclude],
            "seed": self.seed, "device": self.device, "plugins": list(self.plugins),
        }  # fmt: skip


def load_study(name_or_path: str | Path, light_file: str | None = None) -> Study:
    """The study at a path that ends in .yaml, or the installed study of a name.

    Args:
        light_file: an image that takes the place of the study's lights.

    Raises:
        InputError: the study cannot be read, or is wrong; one line that begins with FILE:LINE:COLUMN.
    """
    path = _path_of(name_or_path)
    document = read_document(path)
    model = document.validate(_StudyModel)
    for i, plugin in enumerate(model.plugins):
        try:
            importlib.import_module(plugin)
        except Exception as error:  # a plug-in is anyone's code
            text = f"plugin {plugin!r}: {type(error).__name__}: {error}"
            raise document.error(("plugins", i), text) from error
    if light_file is not None:
        locate(light_file)
        document = replace(document, data={**document.data, "light": {"file": light_file}})
    folder = path.absolute().parent
    forms = {
        kind: [_Form(document, kind, p, v, folder) for p, v in _entries(document, kind)]
        for kind in REGISTRIES
    }
    n_cells = math.prod(sum(form.n_variants() for form in of_kind) for of_kind in forms.values())
    if n_cells > MAX_CELLS:
        raise document.error(
            ("methods",), f"the study has {n_cells} cells, more than {MAX_CELLS}", at_key=True
        )
    for i, metric in enumerate(model.metrics):
        if metric not in METRICS.names():
            raise document.error(
                ("metrics", i), f"metrics: unknown metric {metric!r}{nearest(metric, METRICS.names())}"
            )
        if metric in model.metrics[:i]:
            raise document.error(("metrics", i), f"metrics: {metric!r} is listed twice")
    study = Study(
        title=model.title, source=model.source, question=model.question,
        lights=_items(document, forms["light"]),
        materials=_items(document, forms["material"]),
        views=_items(document, forms["view"]),
        methods=_items(document, forms["methods"]),
        reference=model.reference, metrics=tuple(model.metrics), claims=(), exclude=tuple(model.exclude),
        seed=model.seed, device=model.device, plugins=tuple(model.plugins), name=path.stem, folder=folder,
    )  # fmt: skip
    exclude = _checked_exclude(document, study, any_light=light_file is not None)
    claims = _claims(document, study, any_light=light_file is not None)
    return replace(study, exclude=exclude, claims=claims)


def _path_of(name_or_path: str | Path) -> Path:
    if isinstance(name_or_path, Path) or Path(name_or_path).suffix in (".yaml", ".yml"):
        return Path(name_or_path)
    home = resources.files("glossbench.studies")
    files = [entry for entry in home.iterdir() if entry.name.endswith(".yaml")]
    installed = {entry.name.removesuffix(".yaml"): entry for entry in files}
    if name_or_path not in installed:
        raise InputError(f"unknown study {name_or_path!r}{nearest(name_or_path, installed)}")
    return Path(str(installed[name_or_path]))


def _entries(document: Document, kind: str) -> list[tuple[KeyPath, Any]]:
    """The items of one kind as the file states them, with their paths."""
    value = document.data[kind]
    if value == []:
        raise document.error((kind,), f"{kind} needs at least one item")
    return [((kind, i), v) for i, v in enumerate(value)] if isinstance(value, list) else [((kind,), value)]


class _Axis(NamedTuple):
    """Options that vary together, and the values that they take."""

    options: tuple[str, ...]
    values: list[tuple[Any, ...]]


class _Form:
    """An item as the file states it: a class, the axes of its sweeps, a tuned option."""

    def __init__(self, document: Document, kind: str, path: KeyPath, value: Any, folder: Path) -> None:
        self._document, self._kind, self._folder = document, kind, folder
        name, stated, self.path, at = self._named(path, value)
        if name not in REGISTRIES[kind].names():
            what = kind.removesuffix("s")
            text = f"{path_text(path)}: unknown {what} {name!r}{nearest(name, REGISTRIES[kind].names())}"
            raise document.error(at, text, at_key=at != path)
        self.cls: type[Options] = REGISTRIES[kind].get(name)
        self.tune: Tune | None = None
        self.axes: list[_Axis] = []
        if not isinstance(stated, dict):
            raise document.error(at, f"{path_text(at)}: options must be a mapping, got {stated!r}")
        for option, given in stated.items():
            self._add(option, given)
        options = [option for axis in self.axes for option in axis.options]
        options += [self.tune.option] if self.tune else []
        twice = next((option for option in options if options.count(option) > 1), None)
        if twice:
            text = f"{path_text(self.path)}: {twice!r} is in 'zip', too"
            raise document.error((*self.path, twice), text, at_key=True)

    def n_variants(self) -> int:
        return math.prod(len(axis.values) for axis in self.axes)

    def variants(self) -> Iterator[Item]:
        """The items that the form stands for, the last axis varying fastest."""
        start: dict[str, Any] = {}
        if self.tune and not _has_default(self.cls, self.tune.option):
            start = {self.tune.option: self.tune.low}
        for values in product(*(axis.values for axis in self.axes)):
            options = dict(start)
            for axis, of_axis in zip(self.axes, values, strict=True):
                options |= dict(zip(axis.options, of_axis, strict=True))
            try:
                complete = self.cls.create(options).as_dict()
            except ValueError as error:
                text = str(error).removeprefix(f"{self.cls.name}")
                raise self._document.error(self.path, f"{path_text(self.path)}{text}") from error
            if self._kind == "methods":
                yield MethodItem(self.cls.name, complete, self.tune)
            else:
                yield Item(self.cls.name, complete)

    def _named(self, path: KeyPath, value: Any) -> tuple[str, Any, KeyPath, KeyPath]:
        """Name, options, the path of the options, and the path of the name."""
        if isinstance(value, str):
            is_file = self._kind == "light" and value not in LIGHTS.names() and bool(Path(value).suffix)
            return ("file", {"file": value}, path, path) if is_file else (value, {}, path, path)
        if isinstance(value, dict) and self._kind == "light" and "file" in value:
            if len(value) > 1 or not isinstance(value["file"], dict | None):
                return "file", value, path, path
        if not isinstance(value, dict) or len(value) != 1:
            got = f"the keys {', '.join(map(repr, value))}" if isinstance(value, dict) else repr(value)
            text = f"{path_text(path)} must be a name, or one name with its options below it, got {got}"
            raise self._document.error(path, text)
        [(name, options)] = value.items()
        return name, {} if options is None else options, (*path, name), (*path, name)

    def _add(self, option: str, given: Any) -> None:
        path = (*self.path, option)
        if option == "zip":
            self.axes.append(self._zipped(path, given))
            return
        self._require_known(path, option)
        if isinstance(given, dict) and "tune" in given:
            self.tune = self._tuned(path, option)
            return
        if self._accepts(option, given) or not isinstance(given, list):
            values = [self._checked(path, option, given)]
        else:
            values = self._each(path, option, given)
        self.axes.append(_Axis((option,), [(value,) for value in values]))

    def _accepts(self, option: str, value: Any) -> bool:
        try:
            check(self.cls, option, value)
        except InputError:
            return False
        return True

    def _checked(self, path: KeyPath, option: str, value: Any) -> Any:
        """A value that the option accepts; the file of a light, if beside the study, with its whole path."""
        try:
            check(self.cls, option, value)
        except InputError as error:
            rule = str(error).removeprefix(f"{self.cls.name}.{option}")
            raise self._document.error(path, f"{path_text(path)}{rule}") from error
        if self.cls is not FileLight or option != "file":
            return value
        try:
            found = locate(value, beside=self._folder)
        except InputError as error:
            raise self._document.error(path, f"{path_text(path)}: {error}") from error
        return str(found) if found == self._folder / value else value

    def _each(self, path: KeyPath, option: str, values: list[Any]) -> list[Any]:
        if not values:
            raise self._document.error(path, f"{path_text(path)} sweeps an empty list")
        return [self._checked((*path, i), option, value) for i, value in enumerate(values)]

    def _zipped(self, path: KeyPath, given: Any) -> _Axis:
        if not isinstance(given, dict) or not given or not all(isinstance(v, list) for v in given.values()):
            raise self._document.error(path, f"{path_text(path)} must map options to lists, got {given!r}")
        for option in given:
            self._require_known((*path, option), option)
        lengths = [len(values) for values in given.values()]
        if len(set(lengths)) > 1:
            told = ", ".join(f"{option} has {n}" for option, n in zip(given, lengths, strict=True))
            raise self._document.error(path, f"{path_text(path)} pairs lists of one length, but {told}")
        columns = [self._each((*path, option), option, values) for option, values in given.items()]
        return _Axis(tuple(given), list(zip(*columns, strict=True)))

    def _tuned(self, path: KeyPath, option: str) -> Tune:
        where = path_text(path)
        if self._kind != "methods" or self.tune is not None:
            why = "only one option of an item" if self._kind == "methods" else "only an option of a method"
            raise self._document.error(path, f"{where}: {why} can be tuned")
        model = self._document.validate(_TuneModel, path)
        if model.tune not in METRICS.names():
            text = f"{where}.tune: unknown metric {model.tune!r}{nearest(model.tune, METRICS.names())}"
            raise self._document.error((*path, "tune"), text)
        bounds = model.range or _bounds(self.cls, option)
        if bounds is None:
            text = f"{where} has no bounds to tune between; state range: [low, high]"
            raise self._document.error(path, text)
        low, high = map(float, bounds)
        if not low < high:
            raise self._document.error(
                (*path, "range"), f"{where}.range must be [low, high], low first, got {bounds}"
            )
        # A point that is no whole number, too: a search steps between the ends.
        for value in (low, high, low + (high - low) / math.pi):
            self._checked((*path, "range"), option, value)
        return Tune(option, model.tune, low, high)

    def _require_known(self, path: KeyPath, option: str) -> None:
        known = option_names(self.cls)
        if option not in known:
            text = f"{path_text(path[:-1])}: unknown option {option!r}{nearest(option, known)}"
            raise self._document.error(path, text, at_key=True)


def _bounds(cls: type[Options], option: str) -> list[float] | None:
    """The bounds, themselves allowed, that the annotation of a number states."""
    stated = json_schema(cls)["properties"][option]
    for branch in (stated, *stated.get("anyOf", [])):
        if "minimum" in branch and "maximum" in branch:
            return [branch["minimum"], branch["maximum"]]
    return None


def _has_default(cls: type[Options], option: str) -> bool:
    stated = next(f for f in fields(cls) if f.name == option)  # type: ignore[arg-type]
    return stated.default is not MISSING or stated.default_factory is not MISSING


def _items(document: Document, forms: list[_Form]) -> tuple[Any, ...]:
    """All items of one kind; InputError for one that is there twice: claims would count it twice."""
    found: dict[Item, _Form] = {}
    for form in forms:
        for item in form.variants():
            if item in found:
                text = f"{path_text(form.path)} states the same twice: {item.name} {item.json}"
                raise document.error(form.path, text)
            found[item] = form
    return tuple(found)


def _fits(cell: Cell, entry: dict[str, Any]) -> bool:
    """Whether a cell fits an exclusion; an option is the method's, else the material's, view's or light's."""
    for key, wanted in entry.items():
        if key in PLACES:
            item = getattr(cell, key)
            fits = any(agrees(wanted, name) for name in called(item.name, item.options))
        elif key == "method":
            fits = agrees(wanted, cell.method.name)
        else:
            items = (cell.method, cell.material, cell.view, cell.light)
            holder = next((item for item in items if key in item.options), None)
            fits = holder is not None and agrees(wanted, holder.spelled()[key])
        if not fits:
            return False
    return True


def _checked_exclude(document: Document, study: Study, any_light: bool) -> tuple[dict[str, Any], ...]:
    """The exclusions that leave out a cell; InputError for one that does not, or that has an unknown key.

    Args:
        any_light: the lights are not the study's own, so that what was said about those may fit nothing.
    """
    every = replace(study, exclude=()).cells()
    options = {key for kind in (study.methods, study.materials, study.views, study.lights) for item in kind
               for key in item.options}  # fmt: skip
    known = [*PLACES, "method", *options]
    kept = []
    for i, entry in enumerate(study.exclude):
        path = ("exclude", i)
        for key in entry:
            if key not in known and not any_light:
                text = f"{path_text(path)}: unknown key {key!r}{nearest(key, known)}"
                raise document.error((*path, key), text, at_key=True)
        if entry and any(_fits(cell, entry) for cell in every):
            kept.append(entry)
        elif not any_light:
            raise document.error(path, f"{path_text(path)} fits no cell")
    if all(any(_fits(cell, entry) for entry in kept) for cell in every):
        raise document.error(("exclude",), "exclude leaves no cell")
    return tuple(kept)


def _claims(document: Document, study: Study, any_light: bool) -> tuple[Claim, ...]:
    methods: dict[str, set[str]] = {}
    for item in study.methods:
        methods.setdefault(item.name, set()).update(item.options)
    places = {"light": study.lights, "material": study.materials, "view": study.views}
    names = {place: {name for item in items for name in called(item.name, item.options)}
             for place, items in places.items() if not (any_light and place == "light")}  # fmt: skip
    material_options = {key for item in study.materials for key in item.options}
    found: list[Claim] = []
    for i, entry in enumerate(document.data.get("claims", [])):
        path: KeyPath = ("claims", i)
        kinds = [kind for kind in KINDS if isinstance(entry, dict) and kind in entry]
        if len(kinds) != 1:
            got = " and ".join(kinds) or "none"
            text = f"{path_text(path)} needs one of the keys {', '.join(KINDS)}, got {got}"
            raise document.error(path, text)
        claim = document.validate(KINDS[kinds[0]], path)
        problem = unknown_name(claim, methods, names, material_options, study.metrics)
        if problem:
            at = (*path, *problem[0])
            raise document.error(at, f"{path_text(at)}: {problem[1]}")
        found.append(claim)
    return tuple(found)


def schema() -> dict[str, Any]:
    """JSON Schema of a study, with the options of every registered light, material, view and method."""
    top = _StudyModel.model_json_schema()
    for kind, registry in REGISTRIES.items():
        item = _item_schema(kind, registry)
        top["properties"][kind] = {"anyOf": [item, {"type": "array", "items": item, "minItems": 1}]}
    top["properties"]["claims"]["items"] = {"anyOf": [model.model_json_schema() for model in KINDS.values()]}
    definitions: dict[str, Any] = {}
    top = _hoisted(top, definitions)
    schema_of = "https://json-schema.org/draft/2020-12/schema"
    return {"$schema": schema_of, **top, "title": "glossbench study", "$defs": definitions}


def _hoisted(stated: Any, definitions: dict[str, Any]) -> Any:
    """A schema whose nested definitions have moved to where its references look for them."""
    if isinstance(stated, list):
        return [_hoisted(one, definitions) for one in stated]
    if not isinstance(stated, dict):
        return stated
    definitions |= {name: _hoisted(one, definitions) for name, one in stated.get("$defs", {}).items()}
    return {key: _hoisted(value, definitions) for key, value in stated.items() if key != "$defs"}


def _item_schema(kind: str, registry: Registry[Any]) -> dict[str, Any]:
    """A name, or one name with options; a light may be a file."""
    options = {name: _options_schema(registry.get(name), kind == "methods") for name in registry.names()}
    named = {name: {"anyOf": [of_name, {"type": "null"}]} for name, of_name in options.items()}
    one = {
        "type": "object",
        "properties": named,
        "additionalProperties": False,
        "minProperties": 1,
        "maxProperties": 1,
    }
    if kind == "light":
        return {"anyOf": [{"type": "string"}, {**options["file"], "required": ["file"]}, one]}
    return {"anyOf": [{"enum": registry.names()}, one]}


def _options_schema(cls: type[Options], tunable: bool) -> dict[str, Any]:
    """Each option takes a value or a list of values, and a method's may be tuned."""
    stated = json_schema(cls)
    properties: dict[str, Any] = {}
    lists: dict[str, Any] = {}
    for option, value in stated["properties"].items():
        default = {"default": value.pop("default")} if "default" in value else {}
        # A scalar stands for equal components of a vector.
        forms = [value, *value.get("prefixItems", [])[:1]]
        lists[option] = {"type": "array", "items": {"anyOf": forms}, "minItems": 1}
        tuned = [_TuneModel.model_json_schema()] if tunable else []
        properties[option] = {"anyOf": [*forms, lists[option], *tuned], **default}
    properties["zip"] = {"type": "object", "properties": lists, "additionalProperties": False}
    description = (cls.__doc__ or "").strip().partition("\n")[0]
    return {**stated, "description": description, "properties": properties}
