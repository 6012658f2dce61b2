"""The columns of results: each is declared once, as a field of the record of one cell.

Terminal, page, PDF, spreadsheet and claims read this table; `columns.json` beside `cells.parquet` keeps it, with the
columns of the study's metrics, for a reader that has another version or not the plug-in.
"""

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

# key: what identifies the cell.  condition: light, material and view.  method: the method and its options.
# status: whether it is done.  error: a metric.  cost: a time or memory.  count: a number of samples.
# reference: of the reference image.  provenance: how, where and when it was measured.  note: a sentence for readers.
Role = Literal[
    "key", "condition", "method", "status", "error", "cost", "count", "reference", "provenance", "note"
]  # fmt: skip
NAN = float("nan")
OLD_BUDGET = "samples"  # of results from before there was a column for it
CONDITIONS = ("light", "material", "view")  # what the cells that are compared share
_TYPES: Mapping[str, type] = {each.__name__: each for each in (str, int, float, bool, dict, list)}


@dataclass(frozen=True)
class Column:
    """One column of results.

    Attributes:
        name: in the table.
        type: of a value; a dict or a list is stored as JSON.
        unit: in which people read it; "" without one.
        scale: shown value = scale * stored value.
        role: what kind of thing it says.
        title: for people, such as "shading time".
        group: what belongs together in a table or plot; "" alone.
        lower_is_better: of an error, a cost or a count; of a signed one, for its absolute value.
        signed: its values have both signs.
        adds_up: of a dict of numbers, the sum says something.
        short: its heading in the terminal's table, which is narrow; "" where it is not there.
    """

    name: str
    type: type
    unit: str = ""
    scale: float = 1.0
    role: Role = "provenance"
    title: str = ""
    group: str = ""
    lower_is_better: bool = True
    signed: bool = False
    adds_up: bool = False
    short: str = ""

    @property
    def is_json(self) -> bool:
        """Whether a value is stored as JSON text."""
        return self.type in (dict, list)

    @property
    def heading(self) -> str:
        """Title and unit, as a table or an axis has them: "shading time [ms]"."""
        title = self.title or self.name
        return f"{title} [{self.unit}]" if self.unit else title

    def part(self, name: str) -> "Column":
        """The column of one number of a dict of numbers: `update_seconds.light`."""
        return replace(self, name=f"{self.name}.{name}", type=float, title=f"{self.title}: {name}")

    def in_brief(self, value: Any) -> str:
        """A value as the terminal's table has it, in the unit that people read."""
        return f"{self.scale * value:.4g}" if self.type is float else str(value)

    def as_dict(self) -> dict[str, Any]:
        """What `columns.json` keeps of it: all that is not as usual."""
        own = {each.name: getattr(self, each.name) for each in fields(self) if getattr(self, each.name) != each.default}
        return own | {"type": self.type.__name__}

    @classmethod
    def of_dict(cls, stated: Mapping[str, Any]) -> "Column":
        """A column from `columns.json`; what another version states beside it is left out."""
        own = {each.name: stated[each.name] for each in fields(cls) if each.name in stated}
        return cls(**(own | {"type": _TYPES[own["type"]]}))


def about(role: Role, title: str = "", **stated: Any) -> dict[str, Any]:
    """What a column is beside its name and type, written into the type of a field."""
    return {"role": role, "title": title, **stated}


@dataclass(frozen=True, kw_only=True)
class CellRecord:
    """All that a run knows of one cell: the only writer of a row. A field is a column; metrics bring their own."""

    key: Annotated[str, about("key")]
    reference_key: Annotated[str, about("key")]
    light: Annotated[str, about("condition")]
    material: Annotated[str, about("condition")]
    view: Annotated[str, about("condition")]
    method: Annotated[str, about("method")]
    light_options: Annotated[dict[str, Any], about("condition", "options of the light")] = field(default_factory=dict)
    material_options: Annotated[dict[str, Any], about("condition", "options of the material")] = field(
        default_factory=dict
    )
    view_options: Annotated[dict[str, Any], about("condition", "options of the view")] = field(default_factory=dict)
    options: Annotated[dict[str, Any], about("method", "options of the method")] = field(default_factory=dict)
    tuned: Annotated[dict[str, Any], about("method", "values that tuning found")] = field(default_factory=dict)
    tune: Annotated[dict[str, Any], about("method", "how options are tuned")] = field(default_factory=dict)
    status: Annotated[str, about("status")] = "done"
    reason: Annotated[str, about("status", "why it is not done")] = ""
    notes: Annotated[list[str], about("note")] = field(default_factory=list)
    metrics: Mapping[str, float] = field(default_factory=dict)  # by the names of their columns
    left_out: Annotated[dict[str, list[float]], about("error", "metrics against the reference without each group")] = (
        field(default_factory=dict)
    )
    reference_noise: Annotated[float, about("reference", "noise of the reference", unit="radiance")] = NAN
    reference_peak_noise: Annotated[float, about("reference", "largest noise of a pixel", unit="radiance")] = NAN
    reference_target: Annotated[float, about("reference", "noise that was asked for", unit="radiance")] = NAN
    reference_mean: Annotated[float, about("reference", "mean of the reference", unit="radiance")] = NAN
    reference_samples: Annotated[int, about("reference", "samples per pixel of the reference")] = 0
    at_noise_floor: Annotated[bool, about("reference", "RMS error below twice the reference's noise")] = False
    is_random: Annotated[bool, about("method", "its points are random")] = False
    n_samples: Annotated[int, about("count", "light samples per pixel", short="samples")] = 0
    budget: Annotated[str, about("method", "option that is the budget")] = ""
    stage_seconds: Annotated[dict[str, float], about("cost", "stages", unit="ms", scale=1e3, adds_up=True)] = field(
        default_factory=dict
    )
    update_seconds: Annotated[dict[str, float], about("cost", "update", unit="ms", scale=1e3)] = field(
        default_factory=dict
    )
    state_bytes: Annotated[int, about("cost", "state in memory", unit="MB", scale=1e-6)] = 0
    shade_seconds: Annotated[
        float, about("cost", "shading time", unit="ms", scale=1e3, group="shade", short="shade ms")
    ] = NAN
    shade_seconds_low: Annotated[
        float, about("provenance", "shading time, fastest run", unit="ms", scale=1e3, group="shade")
    ] = NAN
    shade_seconds_high: Annotated[
        float, about("provenance", "shading time, slowest run", unit="ms", scale=1e3, group="shade")
    ] = NAN
    shade_runs: Annotated[int, about("provenance", "timed runs", group="shade")] = 0
    busy: Annotated[float, about("provenance", "processor taken by other work", unit="%", scale=100.0)] = NAN
    reference_seconds: Annotated[float, about("reference", "time of the reference", unit="s")] = NAN
    version: Annotated[str, about("provenance", "version of glossbench")] = ""
    torch: Annotated[str, about("provenance", "version of torch")] = ""
    device: Annotated[str, about("provenance")] = ""
    processor: Annotated[str, about("provenance")] = ""
    seed: Annotated[int, about("provenance")] = 0
    light_key: Annotated[str, about("key")] = ""
    code: Annotated[str, about("key", "hash of the source")] = ""

    def row(self) -> dict[str, Any]:
        """The row of the table: values by column, those of JSON columns as text."""
        found: dict[str, Any] = {}
        for each in fields(self):
            value = getattr(self, each.name)
            found |= value if each.name == "metrics" else {each.name: _text(COLUMNS[each.name], value)}
        return found


def parsed(row: Mapping[str, Any]) -> dict[str, Any]:
    """A row with values for what is JSON, and None for what is missing."""
    found: dict[str, Any] = {key: None if isinstance(v, float) and math.isnan(v) else v for key, v in row.items()}
    for name, column in COLUMNS.items():
        if column.is_json:
            found[name] = json.loads(found.get(name) or "{}")
    if found.get("budget") is None:
        found["budget"] = OLD_BUDGET if OLD_BUDGET in found["options"] else ""
    return found


def _text(column: Column, value: Any) -> Any:
    """A value as it is stored. Options are compared as text, so their order does not count; that of stages does."""
    return json.dumps(value, sort_keys=column.role in ("condition", "method")) if column.is_json else value


def _declared() -> dict[str, Column]:
    hints = get_type_hints(CellRecord, include_extras=True)
    stated = {name: get_args(hint) for name, hint in hints.items() if get_origin(hint) is Annotated}
    return {name: Column(name, get_origin(kind) or kind, **own) for name, (kind, own) in stated.items()}


# Of a whole table, also the names of light, material and view, with the options that tell them from the others there.
COLUMNS: Mapping[str, Column] = _declared() | {
    f"{kind}_name": Column(f"{kind}_name", str, role="condition", title=kind) for kind in CONDITIONS
}


def is_cost(name: str) -> bool:
    """Whether a column is a cost or a count, or a part of one, as `update_seconds.light`."""
    column = COLUMNS.get(name.partition(".")[0])
    return column is not None and column.role in ("cost", "count")


def costs(parts: Mapping[str, Iterable[str]]) -> list[str]:
    """The names of all costs and counts, and of their parts.

    Args:
        parts: the names of the parts of a column that has some.
    """
    found: list[str] = []
    for name in filter(is_cost, COLUMNS):
        found += [name] if COLUMNS[name].adds_up or not COLUMNS[name].is_json else []
        found += [f"{name}.{part}" for part in parts.get(name, ())]
    return found


def with_parts(row: Mapping[str, Any]) -> dict[str, Any]:
    """A parsed row in which each cost that has parts is their sum, and each part is a column of its own."""
    found = dict(row)
    for name in filter(is_cost, COLUMNS):
        if COLUMNS[name].is_json:
            found |= {f"{name}.{part}": value for part, value in row[name].items()}
            found[name] = float(sum(row[name].values()))
    return found
