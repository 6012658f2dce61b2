"""Studies: a YAML file -> a checked Study -> the cells to run."""

import math
import os
from collections.abc import Collection
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import compress, product
from pathlib import Path
from typing import Any

import numpy as np
import torch

from glossbench.brdf.material import Material
from glossbench.catalog.locate import locate
from glossbench.columns import COLUMNS
from glossbench.envmap.lights.file_light import FileLight, make_light
from glossbench.envmap.lights.light import Light
from glossbench.errors import InputError, suggest_nearest
from glossbench.memory import read_size
from glossbench.metrics import METRICS, Metric
from glossbench.metrics.metric import name_columns
from glossbench.options import Options
from glossbench.plugins import import_plugin
from glossbench.process.plugin_imports import loading
from glossbench.process.state import is_foreign
from glossbench.scene.points import View
from glossbench.study.cell_index import CellIndex, Mask
from glossbench.study.cells import Candidate, Cell, group_views, to_text
from glossbench.study.claim_checks import check_claims, check_exclude
from glossbench.study.claims import Claim, list_methods
from glossbench.study.document import Document, KeyPath, format_path, read_document
from glossbench.study.expand import Form
from glossbench.study.schema import KINDS_OF_ITEMS, ReferenceOptions, StudyKeys
from glossbench.study.study_files import find_study_files

MAX_CELLS = 100_000
ENDINGS = (".yaml", ".yml")


@dataclass(frozen=True)
class Study:
    """A question, and everything that is compared to answer it. == ignores the name and folder of the file.

    Attributes:
        exclude: mappings of light, material, view, method or an option to a value; cells that fit one are left out.
        time_limit: seconds that a cell may take, without its reference.
        memory: bytes that all processes of a run may take together; None for no bound.
        name: name of its file, without the ending.
        folder: folder of its file.
    """

    title: str
    source: str
    question: str
    lights: tuple[Light, ...]
    materials: tuple[Material, ...]
    views: tuple[View, ...]
    methods: tuple[Candidate, ...]
    reference: ReferenceOptions
    metrics: tuple[Metric, ...]
    claims: tuple[Claim, ...]
    exclude: tuple[dict[str, Any], ...]
    seed: int
    device: str
    time_limit: float
    plugins: tuple[str, ...]
    name: str = field(compare=False)
    folder: Path = field(compare=False)
    memory: int | None = None

    def with_seed(self, seed: int) -> "Study":
        """A copy with another seed. It is used by the reference and by methods that do not set their own.

        Raises:
            InputError: the seed is below 0 or has more than 32 bits, an option does not accept it, or it makes two
                methods equal.
        """
        if not 0 <= seed < 1 << 32:
            raise InputError(f"seed must be {f'less than {1 << 32}' if seed > 0 else 'at least 0'}, got {seed}")
        methods = tuple(item.with_seed(seed) for item in self.methods)
        if len(set(map(to_text, methods))) < len(methods):
            raise InputError(
                f"seed {seed} is also the stated seed of a method of the study, which would then be there twice"
            )
        return replace(self._select_methods(methods), seed=seed, reference=self.reference.with_seed(seed))

    def only(self, names: Collection[str]) -> "Study":
        """A copy with only some of its methods; InputError for an unknown name."""
        known = {item.name for item in self.methods}
        for name in names:
            if name not in known:
                raise InputError(f"the study has no method {name!r}{suggest_nearest(name, known)}")
        return self._select_methods(tuple(item for item in self.methods if item.name in names))

    def _select_methods(self, methods: tuple[Candidate, ...]) -> "Study":
        """A copy with these methods, without the exclusions and claims that are about other methods."""
        every = replace(self, methods=methods).index
        fits = [every.find_excluded(entry) for entry in self.exclude]
        if fits and np.logical_or.reduce(fits).all():
            raise InputError("exclude leaves no cell")
        exclude = tuple(entry for entry, excluded in zip(self.exclude, fits, strict=True) if excluded.any())
        names = {item.name for item in methods}
        claims = tuple(claim for claim in self.claims if names.issuperset(list_methods(claim)))
        return replace(self, methods=methods, exclude=exclude, claims=claims)

    def cells(self) -> list[Cell]:
        """All combinations light x material x view x method, in this order, without the excluded ones."""
        every = product(self.lights, self.materials, self.views, self.methods)
        return [Cell(*items) for items in compress(every, self.kept)]

    @cached_property
    def kept(self) -> Mask:
        """For each combination, whether no entry of `exclude` leaves it out."""
        kept = np.ones(len(self.index.codes["method"]), bool)
        for entry in self.exclude:
            kept &= ~self.index.find_excluded(entry)
        return kept

    @property
    def metric_columns(self) -> list[str]:
        """The columns of its metrics, in their order."""
        return name_columns([(metric.name, metric.as_dict()) for metric in self.metrics])

    @cached_property
    def measured(self) -> dict[str, Metric]:
        """By column, the metrics of the study and the RMS error, which is always measured."""
        return dict(zip(self.metric_columns, self.metrics, strict=True)) | {"rms": METRICS.create("rms", {})}

    def has_device(self) -> bool:
        """Whether this machine has the device."""
        return self.device == "cpu" or torch.cuda.is_available()

    @cached_property
    def index(self) -> CellIndex:
        """All combinations of its items; a tuned option is as the study states it."""
        kinds: dict[str, tuple[Options | Candidate, ...]] = {
            "light": self.lights,
            "material": self.materials,
            "view": self.views,
            "method": self.methods,
        }
        return CellIndex.from_product({kind: [(i.name, i.as_dict()) for i in items] for kind, items in kinds.items()})

    def resolved(self) -> dict[str, Any]:
        """The study as plain data with all defaults written out; its YAML loads as an equal study."""
        return {
            "title": self.title, "source": self.source, "question": self.question,
            "light": [{item.name: item.as_dict()} for item in self.lights],
            "material": [{item.name: item.as_dict()} for item in self.materials],
            "view": [{item.name: item.as_dict()} for item in self.views],
            "methods": [{item.name: item.as_dict()} for item in self.methods],
            "reference": self.reference.model_dump(),
            "metrics": [self._state_metric(each) for each in self.metrics],
            "claims": [claim.model_dump(mode="json", exclude_none=True) for claim in self.claims],
            "exclude": [dict(entry) for entry in self.exclude],
            "seed": self.seed, "device": self.device, "time_limit": self.time_limit, "plugins": list(self.plugins),
        } | ({"memory": f"{self.memory / 1e9:.9f}".rstrip("0").rstrip(".") + " GB"} if self.memory else {})  # fmt: skip

    def _state_metric(self, metric: Metric) -> str | dict[str, Any]:
        """The metric as a study states it: its name alone if that identifies it, else the name with its options."""
        is_alone = sum(other.name == metric.name for other in self.metrics) == 1
        return metric.name if is_alone and metric.is_usual() else {metric.name: metric.as_dict()}


def load_study(name_or_path: str | Path, light: str | None = None, open_files: bool = False) -> Study:
    """The study at a path that ends in .yaml, or the installed study with this name.

    Args:
        light: an image file, or the name of a light, that replaces the study's lights.
        open_files: also read all files that the study names: images, meshes, measurements.

    Raises:
        InputError: the study cannot be read, or is wrong; one line that begins with FILE:LINE:COLUMN.
    """
    return load_study_with_forms(name_or_path, light, open_files)[0]


def load_study_with_forms(
    name_or_path: str | Path, light: str | None = None, open_files: bool = False
) -> tuple[Study, dict[str, list[Form]]]:
    """The study as `load_study` returns it, and its items as the file states them."""
    path = _find_path(name_or_path)
    document = read_document(path)
    model = document.validate(StudyKeys)
    for i, plugin in enumerate(model.plugins):
        try:
            with loading(f"plugin {plugin!r}", model.time_limit):
                import_plugin(plugin, path.absolute().parent)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # a plug-in may raise anything
            kind = "" if isinstance(error, InputError) else f"{type(error).__name__}: "
            text = f"plugin {plugin!r}: {kind}{error}"
            raise document.make_error(("plugins", i), text) from error
    if light is not None:
        if isinstance(make_light(light, {}), FileLight):
            locate(light)
        document = replace(document, data={**document.data, "light": light})
    folder = path.absolute().parent
    of_metrics = [
        Form(document, "metrics", p, v, folder, model.seed) for p, v in _read_entries(document, "metrics", model)
    ]
    metrics: tuple[Metric, ...] = _expand_items(document, of_metrics, model.time_limit)
    columns = name_columns([(metric.name, metric.as_dict()) for metric in metrics])
    measured = dict(zip(columns, metrics, strict=True))
    if taken := next((column for column in columns if column in COLUMNS), ""):
        raise document.make_error(("metrics",), f"metrics: {taken!r} is the name of another column of the results")
    forms = {
        key: [Form(document, key, p, v, folder, model.seed, measured) for p, v in _read_entries(document, key, model)]
        for key in KINDS_OF_ITEMS
    }
    n_cells = math.prod(sum(form.count_variants() for form in of_kind) for of_kind in forms.values())
    if n_cells > MAX_CELLS:
        raise document.make_error(("methods",), f"the study has {n_cells} cells, more than {MAX_CELLS}", at_key=True)
    if open_files:
        for form in (form for of_kind in forms.values() for form in of_kind):
            form.open_files()
    study = Study(
        title=model.title, source=model.source, question=model.question,
        lights=_expand_items(document, forms["light"], model.time_limit),
        materials=_expand_items(document, forms["material"], model.time_limit),
        views=_expand_items(document, forms["view"], model.time_limit),
        methods=_expand_items(document, forms["methods"], model.time_limit),
        reference=model.reference.with_seed(model.seed), metrics=metrics,
        claims=(), exclude=tuple(model.exclude),
        seed=model.seed, device=model.device, time_limit=model.time_limit, plugins=tuple(model.plugins),
        name=path.stem, folder=folder, memory=read_size(model.memory) if model.memory else None,
    )  # fmt: skip
    study = replace(study, exclude=check_exclude(document, study, any_light=light is not None))
    if open_files:
        _check_views(document, study, forms["methods"])
    return replace(study, claims=check_claims(document, study, any_light=light is not None)), forms


def _check_views(document: Document, study: Study, forms: list[Form]) -> None:
    """InputError, at the place of the method, if a method cannot make the images of its cells."""
    paths = {to_text(candidate): form.path for form in forms for candidate in form.expand()}
    for candidate, views in group_views(study.cells()):
        try:
            candidate.method.check_views(views)
        except InputError as error:
            path = paths[to_text(candidate)]
            raise document.make_error(path, f"{format_path(path)}: {error}") from error


def _find_path(name_or_path: str | Path) -> Path:
    if isinstance(name_or_path, Path) or Path(name_or_path).suffix in ENDINGS:
        return _with_hint(Path(name_or_path))
    installed = find_study_files()
    if name_or_path in installed:
        return installed[name_or_path]
    beside = next((f"{name_or_path}{end}" for end in ENDINGS if os.path.isfile(f"{name_or_path}{end}")), None)
    hint = f"; did you mean {beside!r}?" if beside else suggest_nearest(name_or_path, installed)
    if os.path.isfile(name_or_path):
        hint = f"; the file of that name is not a study: a study ends in {' or '.join(ENDINGS)}"
    raise InputError(f"unknown study {name_or_path!r}{hint}")


def _with_hint(path: Path) -> Path:
    """The path; InputError with the nearest study of its folder if the file is missing but a similar name exists."""
    if not os.path.lexists(path) and path.parent.is_dir():
        files = [file.name for file in path.parent.iterdir() if file.suffix in ENDINGS]
        if "did you mean" in (hint := suggest_nearest(path.name, files)):
            raise InputError(f"cannot read the study {str(path)!r}: No such file or directory{hint}")
    return path


def _read_entries(document: Document, kind: str, model: StudyKeys) -> list[tuple[KeyPath, Any]]:
    """The items of one kind with their paths, as the file states them, or the default items."""
    value = document.data.get(kind, getattr(model, kind))
    if value == []:
        raise document.make_error((kind,), f"{kind} needs at least one item")
    return [((kind, i), v) for i, v in enumerate(value)] if isinstance(value, list) else [((kind,), value)]


def _expand_items(document: Document, forms: list[Form], time_limit: float) -> tuple[Any, ...]:
    """All items of one kind; InputError for an item that occurs twice, because claims would count it twice."""
    found: dict[str, Any] = {}
    for form in forms:
        with loading(form.cls.name, time_limit) if is_foreign(form.cls) else nullcontext():
            variants = list(form.expand())
        for item in variants:
            key = to_text(item)
            if key in found:
                text = f"{format_path(form.path)} states the same twice: {key}"
                raise document.make_error(form.path, text)
            found[key] = item
    return tuple(found.values())
