"""Studies: a YAML file -> a checked Study -> the cells to be run."""

import json
import math
from collections.abc import Collection
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any

from glossbench.claims import (
    COLUMNS,
    KINDS,
    PLACES,
    Claim,
    called,
    method_of,
    methods_of,
    options_of,
    places_of,
    sides_of,
    unknown_name,
    within,
)
from glossbench.envmap.lights import FileLight, light_named, locate
from glossbench.errors import InputError, nearest
from glossbench.items import Cell, Item, MethodItem
from glossbench.metrics import METRICS
from glossbench.plugin_loading import loading
from glossbench.plugins import import_plugin
from glossbench.process_state import is_foreign
from glossbench.schema import REGISTRIES, ReferenceOptions, StudyKeys
from glossbench.shading import CHANGES, METHODS, stated_stages
from glossbench.study_files import study_files
from glossbench.sweeps import Form
from glossbench.yaml_marks import Document, KeyPath, path_text, read_document

MAX_CELLS = 100_000


@dataclass(frozen=True)
class Study:
    """A question, and all that is compared to answer it; the name of the file does not count in ==.

    Attributes:
        exclude: mappings of light, material, view, method or an option to a value; what fits is left out.
        time_limit: seconds that a cell may take, its reference not counted.
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
    time_limit: float
    plugins: tuple[str, ...]
    name: str = field(compare=False)
    folder: Path = field(compare=False)

    def with_seed(self, seed: int) -> "Study":
        """The study with another seed, which all takes that has no stated one: the reference, and methods.

        Raises:
            InputError: a seed below 0 or of more than 32 bits, one that an option does not take, or that makes two
                methods the same.
        """
        if not 0 <= seed < 1 << 32:
            raise InputError(f"seed must be {f'less than {1 << 32}' if seed > 0 else 'at least 0'}, got {seed}")
        methods = tuple(item.with_seed(seed) for item in self.methods)
        if len({(item.name, item.json) for item in methods}) < len(methods):
            raise InputError(f"seed {seed} is the one that a method of the study states, which is then there twice")
        return replace(self._comparing(methods), seed=seed, reference=self.reference.with_seed(seed))

    def only(self, names: Collection[str]) -> "Study":
        """The study of some of its methods; InputError for a name that it does not have."""
        known = {item.name for item in self.methods}
        for name in names:
            if name not in known:
                raise InputError(f"the study has no method {name!r}{nearest(name, known)}")
        return self._comparing(tuple(item for item in self.methods if item.name in names))

    def _comparing(self, methods: tuple[MethodItem, ...]) -> "Study":
        """The study of these methods, without the exclusions and claims that are about others."""
        every = replace(self, methods=methods, exclude=()).cells()
        exclude = tuple(entry for entry in self.exclude if any(cell.fits(entry) for cell in every))
        if all(any(cell.fits(entry) for entry in exclude) for cell in every):
            raise InputError("exclude leaves no cell")
        names = {item.name for item in methods}
        claims = tuple(claim for claim in self.claims if names.issuperset(methods_of(claim)))
        return replace(self, methods=methods, exclude=exclude, claims=claims)

    def cells(self) -> list[Cell]:
        """Every light x material x view x method in this order, but those excluded."""
        every = (Cell(*items) for items in product(self.lights, self.materials, self.views, self.methods))
        return [cell for cell in every if not any(cell.fits(entry) for entry in self.exclude)]

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
            "seed": self.seed, "device": self.device, "time_limit": self.time_limit, "plugins": list(self.plugins),
        }  # fmt: skip


def load_study(name_or_path: str | Path, light: str | None = None) -> Study:
    """The study at a path that ends in .yaml, or the installed study of a name.

    Args:
        light: takes the place of the study's lights: an image file, or a light's name.

    Raises:
        InputError: the study cannot be read, or is wrong; one line that begins with FILE:LINE:COLUMN.
    """
    path = _path_of(name_or_path)
    document = read_document(path)
    model = document.validate(StudyKeys)
    for i, plugin in enumerate(model.plugins):
        try:
            with loading(f"plugin {plugin!r}", model.time_limit):
                import_plugin(plugin, path.absolute().parent)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # a plug-in is anyone's code
            text = f"plugin {plugin!r}: {type(error).__name__}: {error}"
            raise document.error(("plugins", i), text) from error
    if light is not None:
        if isinstance(light_named(light, {}), FileLight):
            locate(light)
        document = replace(document, data={**document.data, "light": light})
    folder = path.absolute().parent
    forms = {
        kind: [Form(document, kind, p, v, folder, model.seed) for p, v in _entries(document, kind)]
        for kind in REGISTRIES
    }
    n_cells = math.prod(sum(form.n_variants() for form in of_kind) for of_kind in forms.values())
    if n_cells > MAX_CELLS:
        raise document.error(("methods",), f"the study has {n_cells} cells, more than {MAX_CELLS}", at_key=True)
    for i, metric in enumerate(model.metrics):
        if metric not in METRICS.names():
            raise document.error(
                ("metrics", i), f"metrics: unknown metric {metric!r}{nearest(metric, METRICS.names())}"
            )
        if metric in model.metrics[:i]:
            raise document.error(("metrics", i), f"metrics: {metric!r} is listed twice")
    study = Study(
        title=model.title, source=model.source, question=model.question,
        lights=_items(document, forms["light"], model.time_limit),
        materials=_items(document, forms["material"], model.time_limit),
        views=_items(document, forms["view"], model.time_limit),
        methods=_items(document, forms["methods"], model.time_limit),
        reference=model.reference.with_seed(model.seed), metrics=tuple(model.metrics),
        claims=(), exclude=tuple(model.exclude),
        seed=model.seed, device=model.device, time_limit=model.time_limit, plugins=tuple(model.plugins),
        name=path.stem, folder=folder,
    )  # fmt: skip
    exclude = _checked_exclude(document, study, any_light=light is not None)
    study = replace(study, exclude=exclude, claims=_claims(document, study, any_light=light is not None))
    _check_where(document, study, any_light=light is not None)
    return study


def _path_of(name_or_path: str | Path) -> Path:
    if isinstance(name_or_path, Path) or Path(name_or_path).suffix in (".yaml", ".yml"):
        return Path(name_or_path)
    installed = study_files()
    if name_or_path not in installed:
        raise InputError(f"unknown study {name_or_path!r}{nearest(name_or_path, installed)}")
    return installed[name_or_path]


def _entries(document: Document, kind: str) -> list[tuple[KeyPath, Any]]:
    """The items of one kind as the file states them, with their paths."""
    value = document.data[kind]
    if value == []:
        raise document.error((kind,), f"{kind} needs at least one item")
    return [((kind, i), v) for i, v in enumerate(value)] if isinstance(value, list) else [((kind,), value)]


def _items(document: Document, forms: list[Form], time_limit: float) -> tuple[Any, ...]:
    """All items of one kind; InputError for one that is there twice: claims would count it twice."""
    found: dict[tuple[str, str], Item] = {}
    for form in forms:
        with loading(form.cls.name, time_limit) if is_foreign(form.cls) else nullcontext():
            variants = list(form.variants())
        for item in variants:
            if (item.name, item.json) in found:
                text = f"{path_text(form.path)} states the same twice: {item.name} {item.json}"
                raise document.error(form.path, text)
            found[item.name, item.json] = item
    return tuple(found.values())


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
        if entry and any(cell.fits(entry) for cell in every):
            kept.append(entry)
        elif not any_light:
            raise document.error(path, f"{path_text(path)} fits no cell")
    if all(any(cell.fits(entry) for entry in kept) for cell in every):
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
    stages = [name for method in methods for name in stated_stages(METHODS.get(method))]
    costs = [*COLUMNS, *(f"stage_seconds.{name}" for name in stages), *(f"update_seconds.{name}" for name in CHANGES)]
    for i, entry in enumerate(document.data.get("claims", [])):
        path: KeyPath = ("claims", i)
        kinds = [kind for kind in KINDS if isinstance(entry, dict) and kind in entry]
        if len(kinds) != 1:
            got = " and ".join(kinds) or "none"
            text = f"{path_text(path)} needs one of the keys {', '.join(KINDS)}, got {got}"
            raise document.error(path, text)
        claim = document.validate(KINDS[kinds[0]], path)
        problem = unknown_name(claim, methods, names, material_options, study.metrics, costs)
        if problem:
            at = (*path, *problem[0])
            raise document.error(at, f"{path_text(at)}: {problem[1]}")
        found.append(claim)
    return tuple(found)


def _check_where(document: Document, study: Study, any_light: bool) -> None:
    """InputError for a claim that no cell of one of its sides is about; a tuned option may become anything."""
    rows: dict[str, list[dict[str, Any]]] = {item.name: [] for item in study.methods}
    for cell in study.cells():
        tuned = cell.method.tune.option if cell.method.tune else None
        row: dict[str, Any] = {"options": {k: v for k, v in cell.method.options.items() if k != tuned}}
        for place in PLACES:
            row |= {place: getattr(cell, place).name, f"{place}_options": getattr(cell, place).options}
        rows[cell.method.name].append(row)
    for i, claim in enumerate(study.claims):
        where = {key: value for key, value in claim.where.items() if not (any_light and key == "light")}
        of_methods = {key for item in study.methods if item.name in methods_of(claim) for key in item.options}
        for at, side in sides_of(claim).items():
            name = method_of(side)
            wanted = {("claims", i, "where") if where else ("claims", i): where,
                      ("claims", i, *at, name): options_of(side)}  # fmt: skip
            wanted |= {("claims", i, *at, place): {place: value} for place, value in places_of(side).items()
                       if not (any_light and place == "light")}  # fmt: skip
            if any(all(within(row, w, of_methods) for w in wanted.values()) for row in rows[name]):
                continue
            alone = (path for path, w in wanted.items() if not any(within(row, w, of_methods) for row in rows[name]))
            path: KeyPath = next(alone, ("claims", i))
            held = _values(rows[name], wanted.get(path, {**where, **options_of(side), **places_of(side)}))
            raise document.error(path, f"{path_text(path)} fits no cell of {name}{held}")


def _values(rows: list[dict[str, Any]], keys: Collection[str]) -> str:
    """The values that cells have of some options, or of their light, material or view: "; they have samples 4, 8"."""
    told = []
    for key in keys:
        held = [(row | row["material_options"] | row["options"]).get(key) for row in rows]
        values = dict.fromkeys(json.dumps(value) for value in held if value is not None)
        told.append(f"{key} {', '.join(values)}")
    return f"; they have {' and '.join(told)}" if rows and told else ""
