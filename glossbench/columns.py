"""The columns of results: each is declared once, as a field of the record of one cell.

The terminal, the page, the PDF, the spreadsheet and the claims read this table. `columns.json`, in the folder of
`cells.parquet`, stores it together with the columns of the study's metrics, for a reader that has another version of
glossbench or does not have the plug-in.
"""

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

# key: identifies the cell.  condition: light, material or view.  method: the method or its options.
# status: whether the cell is done.  error: a metric.  cost: a time or memory.  count: a number of samples.
# reference: a property of the reference image.  provenance: how, where and when the cell was measured.
# note: a sentence for readers.
Role = Literal[
    "key", "condition", "method", "status", "error", "cost", "count", "reference", "provenance", "note"
]  # fmt: skip
NAN = float("nan")
OLD_BUDGET = "samples"  # the budget of results that are older than its column
CONDITIONS = ("light", "material", "view")  # cells that are compared share these
_TYPES: Mapping[str, type] = {each.__name__: each for each in (str, int, float, bool, dict, list)}


@dataclass(frozen=True)
class Column:
    """One column of results.

    Attributes:
        name: its name in the table.
        type: the type of a value; a dict or a list is stored as JSON.
        unit: the unit in which people read it; "" if it has none.
        scale: shown value = scale * stored value.
        role: the kind of information, see `Role`.
        title: the name that people read, such as "shading time".
        group: columns of one group stand together in a table or plot; "" if the column stands alone.
        lower_is_better: whether a lower value of an error, cost or count is better; for a signed column, a lower
            absolute value.
        signed: whether its values have both signs.
        adds_up: whether the sum of a dict of numbers has a meaning.
        short: its heading in the narrow table of the terminal; "" if that table does not show it.
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
        """Title and unit, for a table or an axis: "shading time [ms]"."""
        title = self.title or self.name
        return f"{title} [{self.unit}]" if self.unit else title

    def part(self, name: str) -> "Column":
        """The column of one number in a dict of numbers, such as `update_seconds.light`."""
        return replace(self, name=f"{self.name}.{name}", type=float, title=f"{self.title}: {name}")

    def format_brief(self, value: Any) -> str:
        """A value for the terminal's table, in the unit that people read; "" for an unknown one."""
        if value is None:
            return ""
        return f"{self.scale * value:.4g}" if self.type is float else str(value)

    def as_dict(self) -> dict[str, Any]:
        """The entry in `columns.json`: the type, and every attribute that does not have its default."""
        own = {each.name: getattr(self, each.name) for each in fields(self) if getattr(self, each.name) != each.default}
        return own | {"type": self.type.__name__}

    @classmethod
    def from_dict(cls, stated: Mapping[str, Any]) -> "Column":
        """A column from its entry in `columns.json`. Attributes that only another version knows are ignored."""
        own = {each.name: stated[each.name] for each in fields(cls) if each.name in stated}
        return cls(**(own | {"type": _TYPES[own["type"]]}))


def describe_column(role: Role, title: str = "", **stated: Any) -> dict[str, Any]:
    """The attributes of a column other than its name and type, for the annotation of a field."""
    return {"role": role, "title": title, **stated}


@dataclass(frozen=True, kw_only=True)
class CellRecord:
    """All that a run knows about one cell. Only this class writes rows. A field is a column; metrics add their own."""

    key: Annotated[str, describe_column("key")]
    reference_key: Annotated[str, describe_column("key")]
    light: Annotated[str, describe_column("condition")]
    material: Annotated[str, describe_column("condition")]
    view: Annotated[str, describe_column("condition")]
    method: Annotated[str, describe_column("method")]
    light_options: Annotated[dict[str, Any], describe_column("condition", "options of the light")] = field(
        default_factory=dict
    )
    material_options: Annotated[dict[str, Any], describe_column("condition", "options of the material")] = field(
        default_factory=dict
    )
    view_options: Annotated[dict[str, Any], describe_column("condition", "options of the view")] = field(
        default_factory=dict
    )
    options: Annotated[dict[str, Any], describe_column("method", "options of the method")] = field(default_factory=dict)
    tuned: Annotated[dict[str, Any], describe_column("method", "values that tuning found")] = field(
        default_factory=dict
    )
    tune: Annotated[dict[str, Any], describe_column("method", "how options are tuned")] = field(default_factory=dict)
    status: Annotated[str, describe_column("status")] = "done"
    reason: Annotated[str, describe_column("status", "why it is not done")] = ""
    notes: Annotated[list[str], describe_column("note")] = field(default_factory=list)
    metrics: Mapping[str, float] = field(default_factory=dict)  # by the names of their columns
    left_out: Annotated[
        dict[str, list[float]], describe_column("error", "metrics against the reference without each group")
    ] = field(default_factory=dict)
    reference_noise: Annotated[float, describe_column("reference", "noise of the reference", unit="radiance")] = NAN
    reference_peak_noise: Annotated[
        float, describe_column("reference", "largest noise of a pixel", unit="radiance")
    ] = NAN
    reference_target: Annotated[float, describe_column("reference", "target for the noise", unit="radiance")] = NAN
    reference_mean: Annotated[float, describe_column("reference", "mean of the reference", unit="radiance")] = NAN
    reference_samples: Annotated[int, describe_column("reference", "samples per pixel of the reference")] = 0
    reference_method: Annotated[str, describe_column("reference", "how the reference was computed")] = ""
    at_noise_floor: Annotated[bool, describe_column("reference", "RMS error below twice the reference's noise")] = False
    is_random: Annotated[bool, describe_column("method", "its points are random")] = False
    n_samples: Annotated[int, describe_column("count", "light samples per pixel", short="samples")] = 0
    budget: Annotated[str, describe_column("method", "option that is the budget")] = ""
    stage_seconds: Annotated[
        dict[str, float], describe_column("cost", "stages", unit="ms", scale=1e3, adds_up=True)
    ] = field(default_factory=dict)
    update_seconds: Annotated[dict[str, float], describe_column("cost", "update", unit="ms", scale=1e3)] = field(
        default_factory=dict
    )
    state_bytes: Annotated[int, describe_column("cost", "state in memory", unit="MB", scale=1e-6)] = 0
    shade_seconds: Annotated[
        float, describe_column("cost", "shading time", unit="ms", scale=1e3, group="shade", short="shade ms")
    ] = NAN
    shade_seconds_low: Annotated[
        float, describe_column("provenance", "shading time, fastest run", unit="ms", scale=1e3, group="shade")
    ] = NAN
    shade_seconds_high: Annotated[
        float, describe_column("provenance", "shading time, slowest run", unit="ms", scale=1e3, group="shade")
    ] = NAN
    shade_runs: Annotated[int, describe_column("provenance", "timed runs", group="shade")] = 0
    busy: Annotated[
        float, describe_column("provenance", "processor time used by other programs", unit="%", scale=100.0)
    ] = NAN
    reference_seconds: Annotated[float, describe_column("reference", "time of the reference", unit="s")] = NAN
    kernels: Annotated[dict[str, str], describe_column("provenance", "how its kernels ran")] = field(
        default_factory=dict
    )
    version: Annotated[str, describe_column("provenance", "version of glossbench")] = ""
    torch: Annotated[str, describe_column("provenance", "version of torch")] = ""
    device: Annotated[str, describe_column("provenance")] = ""
    processor: Annotated[str, describe_column("provenance")] = ""
    seed: Annotated[int, describe_column("provenance")] = 0
    light_key: Annotated[str, describe_column("key")] = ""
    code: Annotated[str, describe_column("key", "hash of the source")] = ""

    def to_row(self) -> dict[str, Any]:
        """The row of the table: the value of each column; values of JSON columns are text."""
        found: dict[str, Any] = {}
        for each in fields(self):
            value = getattr(self, each.name)
            found |= value if each.name == "metrics" else {each.name: _to_stored(COLUMNS[each.name], value)}
        return found


def parse_row(row: Mapping[str, Any]) -> dict[str, Any]:
    """A row in which JSON text is replaced by its value, and a missing value by None."""
    found: dict[str, Any] = {key: None if isinstance(v, float) and math.isnan(v) else v for key, v in row.items()}
    for name, column in COLUMNS.items():
        if column.is_json:
            found[name] = json.loads(found.get(name) or "{}")
    if found.get("budget") is None:
        found["budget"] = OLD_BUDGET if OLD_BUDGET in found["options"] else ""
    return found


def _to_stored(column: Column, value: Any) -> Any:
    """A value as it is stored. Options are compared as text, so their keys are sorted; the stages keep their order."""
    return json.dumps(value, sort_keys=column.role in ("condition", "method")) if column.is_json else value


def _find_columns() -> dict[str, Column]:
    hints = get_type_hints(CellRecord, include_extras=True)
    stated = {name: get_args(hint) for name, hint in hints.items() if get_origin(hint) is Annotated}
    return {name: Column(name, get_origin(kind) or kind, **own) for name, (kind, own) in stated.items()}


# A whole table also has the names of light, material and view, with the options that distinguish them in this table.
COLUMNS: Mapping[str, Column] = _find_columns() | {
    f"{kind}_name": Column(f"{kind}_name", str, role="condition", title=kind) for kind in CONDITIONS
}


def is_cost(name: str) -> bool:
    """Whether a column is a cost or a count, or a part of one, such as `update_seconds.light`."""
    column = COLUMNS.get(name.partition(".")[0])
    return column is not None and column.role in ("cost", "count")


def list_costs(parts: Mapping[str, Iterable[str]]) -> list[str]:
    """The names of all costs and counts, and of their parts.

    Args:
        parts: for each column that has parts, their names.
    """
    found: list[str] = []
    for name in filter(is_cost, COLUMNS):
        found += [name] if COLUMNS[name].adds_up or not COLUMNS[name].is_json else []
        found += [f"{name}.{part}" for part in parts.get(name, ())]
    return found


def read_cost(row: Mapping[str, Any], name: str, part: str = "") -> float | None:
    """A cost of a parsed row, or a part of it; None if it is unknown.

    If nothing was timed, only the shading time may be known: that of an image from elsewhere can be stated.
    """
    if row.get("shade_runs") == 0 and not name.startswith("shade_seconds"):
        return None
    value = row.get(name)
    if isinstance(value, Mapping):
        return float(value.get(part, 0) if part else sum(value.values()))
    return value


def with_parts(row: Mapping[str, Any]) -> dict[str, Any]:
    """A parsed row in which each cost with parts is the sum of these parts, and each part is a separate column."""
    found = dict(row)
    for name in filter(is_cost, COLUMNS):
        if COLUMNS[name].is_json:
            found |= {f"{name}.{part}": value for part, value in row[name].items()}
        if COLUMNS[name].role == "cost":
            found[name] = read_cost(row, name)
    return found
