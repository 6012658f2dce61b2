"""Sweeps of a study: numbers in which cells differ while all else is equal; and the places where lines are compared."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from glossbench.columns import CONDITIONS
from glossbench.study.labels import (
    distinguish_rows,
    format_options,
    identify,
    name_items,
    read_budget,
    read_number,
    read_stated,
)

from ..style import assign_looks
from .conditions import Group, list_methods

SAMPLES = "samples"
FEW_LINES = 6  # a printed plot with more lines is divided
FEWEST = 3  # values of a quantity that a study investigates
ASIDE = ("seed",)  # numbers over which a plot has no meaning


@dataclass(frozen=True)
class Label:
    """The name and look of a line, which distinguish it from other lines.

    Attributes:
        index: index of the line in the study, which selects the marker.
        method: index of its method, which selects the colour.
        colour: the colour of its method, in a different shade for each line of the method.
        dash: index among the lines of its method.
        facet: if there are more than `FEW_LINES`: its index among the lines of its method with the same value of the
            option that divides the lines most evenly; None if no lines of its method share a value.
        options: the options in its name, as text.
        budget: the option that is the budget of its method; "" without one.
    """

    name: str
    index: int
    method: int
    colour: str
    dash: int = 0
    facet: int | None = None
    options: Mapping[str, str] = field(default_factory=dict)
    budget: str = ""


@dataclass(frozen=True, eq=False)
class Sweep:
    """A swept number: light samples, an option of methods, or a parameter of light, material or view.

    Attributes:
        name: "samples", the name of the option, or the full name of the parameter, "material.s"; "method.samples" is an
            option of this name that is not the budget of its method.
        labels: the label of a line, by the key of each of its cells.
        n_values: the largest number of values that a line has; 1 if nothing is swept.
    """

    name: str
    labels: Mapping[str, Label]
    n_values: int = 1

    @property
    def kind(self) -> str:
        """Which of light, material and view has the parameter; "" for samples and options."""
        kind = self.name.partition(".")[0]
        return kind if kind in CONDITIONS and "." in self.name else ""

    @property
    def parameter(self) -> str:
        """The name of the number in its light, material, view or method."""
        return self.name.removeprefix(f"{self.kind or 'method'}.")

    @property
    def full_name(self) -> str:
        """The name with its owner: "material.alpha", "method.regions"; or "samples"."""
        return self.name if self.name == SAMPLES or self.kind else f"method.{self.parameter}"

    @property
    def title(self) -> str:
        """The label of the axis."""
        if self.name == SAMPLES:
            return "light samples per pixel"
        return f"{self.parameter} of the {self.kind}" if self.kind else self.parameter

    def value(self, row: Mapping[str, Any]) -> float | None:
        """The number of a cell; None if the cell does not have it."""
        return read_number(
            row["n_samples"] if self.name == SAMPLES else _read_options(row, self.kind).get(self.parameter)
        )

    def point(self, row: Mapping[str, Any]) -> tuple[int, Any]:
        """What a cell shares with the same cell under another light: its line and its stated value."""
        asked: Any = self.value(row)
        if self.name == SAMPLES:
            budget = read_budget(row)
            asked = asked if budget is None else budget
        elif not self.kind and _is_tuned(row, self.parameter):
            asked = "tuned"  # its value differs between lights
        return self.labels[row["key"]].index, asked


class Place(NamedTuple):
    """Where lines are compared: one condition, or the mean over several lights.

    Attributes:
        lights: the groups of each light: one group, or several that differ only in a swept parameter.
    """

    title: str
    sweep: Sweep
    lights: Sequence[Sequence[Group]]

    @property
    def groups(self) -> list[Group]:
        """The groups of all lights."""
        return [group for groups in self.lights for group in groups]


def find_sweeps(groups: Sequence[Group], claims: Iterable[Mapping[str, Any]] = ()) -> dict[str, Sweep]:
    """The swept quantities by name; "samples" is always present. The first is the report's default axis.

    It is a quantity with at least `FEWEST` values: (1) one that a slope claim uses, (2) samples, (3) the one with the
    most values, if every method has it.
    """
    rows = [cell.row for group in groups for cell in group.done]
    found: list[Sweep] = []
    for name in [SAMPLES, *_find_candidates(rows)]:
        sweep = Sweep(name, _label_lines(groups, name))
        n_values = max((_n_values(place) for place in find_places(groups, sweep)), default=1)
        if n_values > 1 or name == SAMPLES:
            found.append(Sweep(name, sweep.labels, n_values))
    asked = (find_named(found, claim["over"]) for claim in claims if "over" in claim)
    wanted = [*(sweeps[0].name for sweeps in asked if sweeps), SAMPLES]

    def rank(sweep: Sweep) -> tuple[int, int, bool]:
        if sweep.n_values < FEWEST or (sweep.name not in wanted and any(sweep.value(row) is None for row in rows)):
            return len(wanted) + 1, 0, sweep.name != SAMPLES
        return wanted.index(sweep.name) if sweep.name in wanted else len(wanted), -sweep.n_values, False

    return {sweep.name: sweep for sweep in sorted(found, key=rank)}


def find_named(sweeps: Iterable[Sweep], name: str) -> list[Sweep]:
    """The sweeps that a name may mean: "samples", a full name such as material.alpha, or a short name, alpha."""
    known = list(sweeps)
    exact = [sweep for sweep in known if name == sweep.full_name]
    return exact or [sweep for sweep in known if sweep.name != SAMPLES and name == sweep.parameter]


def with_costs(sweeps: Mapping[str, Sweep]) -> list[Sweep]:
    """The sweeps along which error is plotted against cost: not over conditions, and no line has a fixed budget."""
    is_budgeted = sweeps[SAMPLES].n_values > 1
    return [
        sweep
        for sweep in sweeps.values()
        if not sweep.kind
        and not (is_budgeted and any(label.budget in label.options for label in sweep.labels.values()))
    ]


def find_places(groups: Sequence[Group], sweep: Sweep) -> list[Place]:
    """A place for the groups that differ only in the sweep; and for each material and view the mean over lights."""
    rows = [cell.row for group in groups for cell in group.cells]
    without = {kind: sweep.parameter if kind == sweep.kind else "" for kind in CONDITIONS}
    names = {kind: name_items(kind, rows, without[kind]) for kind in CONDITIONS}
    alike: dict[tuple[str, ...], list[Group]] = {}
    for group in groups:
        alike.setdefault(tuple(identify(kind, group.cells[0].row, without[kind]) for kind in CONDITIONS), []).append(
            group
        )
    found, shared = [], dict[str, list[list[Group]]]()
    for key, members in alike.items():
        light, *others = (names[kind][each] for kind, each in zip(CONDITIONS, key, strict=True))
        place = Place(", ".join([light, *others]), sweep, [members])
        if sweep.kind and _n_values(place) < 2:
            continue
        found.append(place)
        shared.setdefault(", ".join(others), []).append(members)
    means = [
        Place(f"mean over {len(lights)} lights, {others}", sweep, lights)
        for others, lights in shared.items()
        if len(lights) > 1
    ]
    return [*found, *means]


def _read_options(row: Mapping[str, Any], kind: str) -> Mapping[str, Any]:
    options: Mapping[str, Any] = row[f"{kind}_options" if kind else "options"]
    return options


def _find_candidates(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Options and parameters with more than one number, without tuned options."""
    numbers: dict[str, set[float]] = {}
    for row in rows:
        for kind in ("", *CONDITIONS):
            for key, value in _read_options(row, kind).items():
                number = read_number(value)
                if number is None or key in ASIDE or (kind == "" and _is_tuned(row, key)):
                    continue
                if kind == "" and key == SAMPLES:
                    if key != row["budget"]:
                        numbers.setdefault(f"method.{key}", set()).add(number)
                else:
                    numbers.setdefault(f"{kind}.{key}" if kind else key, set()).add(number)
    return [name for name, values in numbers.items() if len(values) > 1]


def _label_lines(groups: Sequence[Group], over: str) -> dict[str, Label]:
    """The label of each cell's line, by the cell's key. A line is a method with the options that distinguish it.

    If the names of other lines contain their budgets, the only budget of a method is in its name, too.
    """
    cells = sorted((cell for group in groups for cell in group.cells), key=lambda cell: cell.index)
    rows = [cell.row for cell in cells]
    names: dict[str, str] = {}  # by key of a cell
    lines: dict[str, tuple[str, dict[str, str], str]] = {}  # method, options and budget, by name
    told = [options for _, options in distinguish_rows(rows, _name_option(over))]
    has_budgets = any(row["budget"] in options for row, options in zip(rows, told, strict=True))
    for row, options in zip(rows, told, strict=True):
        sole = (
            {row["budget"]: row["options"].get(row["budget"])} if has_budgets and read_budget(row) is not None else {}
        )
        called = format_options(
            options | {key: value for key, value in sole.items() if key not in (*options, _name_option(over))}
        )
        name = f"{row['method']} ({called})" if called else str(row["method"])
        names[row["key"]] = name
        lines[name] = str(row["method"]), options, row["budget"]
    of_methods: dict[str, list[dict[str, str]]] = {}
    for method, options, _ in lines.values():
        of_methods.setdefault(method, []).append(options)
    leading = {method: _choose_leading(own) for method, own in of_methods.items()}
    count = Counter((method, options.get(leading[method])) for method, options, _ in lines.values())
    divided = {method for (method, _), n in count.items() if n > 1 and len(lines) > FEW_LINES}
    hues = list_methods(groups)
    labels: dict[str, Label] = {}
    drawn = assign_looks([method for method, _, _ in lines.values()], hues)
    alike: Counter[tuple[str, str | None]] = Counter()
    for index, ((name, (method, options, budget)), (colour, dash)) in enumerate(zip(lines.items(), drawn, strict=True)):
        led = method, options.get(leading[method])
        labels[name] = Label(
            name, index, hues[method], colour, dash, alike[led] if method in divided else None, options, budget,
        )  # fmt: skip
        alike[led] += 1
    return {key: labels[name] for key, name in names.items()}


def _name_option(name: str) -> str | None:
    return None if name == SAMPLES else name.removeprefix("method.")


def _choose_leading(lines: Sequence[Mapping[str, str]]) -> str:
    """The option that divides the lines most evenly: its most frequent value has the fewest lines."""
    keys = dict.fromkeys(key for line in lines for key in line)
    most = {key: max(Counter(line.get(key) for line in lines).values()) for key in keys}
    return min(most, key=lambda key: most[key], default="")


def _is_tuned(row: Mapping[str, Any], option: str) -> bool:
    return read_stated(row).get(option) != row["options"].get(option)


def _n_values(place: Place) -> int:
    """The largest number of values of the swept quantity that a line has at a place."""
    values: dict[int, set[float]] = {}
    for group in place.lights[0]:
        for cell in group.done:
            value = place.sweep.value(cell.row)
            if value is not None:
                values.setdefault(place.sweep.point(cell.row)[0], set()).add(value)
    return max(map(len, values.values()), default=0)
