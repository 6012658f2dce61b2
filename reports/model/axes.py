"""What a study sweeps: the numbers that its cells differ in alone, and the places where lines are compared."""

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
FEW_LINES = 6  # more, and a plot for print is divided
FEWEST = 3  # values that make a quantity what a study is about
ASIDE = ("seed",)  # numbers that are no quantity of their own: no plot over a seed says anything


@dataclass(frozen=True)
class Label:
    """What tells a line from others: its name, and how it looks.

    Attributes:
        index: its place in the study, which gives the marker.
        method: the place of its method, which gives the colour.
        colour: that of its method, in a shade of its own where the method has several lines.
        dash: its place among the lines of its method.
        facet: where there are more than `FEW_LINES`, its place among those of its method that share the value of the
            option that divides them the most evenly; None where none of its method shares one.
        options: those in its name, as text.
        budget: the option that is its method's budget; "" without one.
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
    """A number that cells differ in alone: light samples, an option of methods, a parameter of light, material or view.

    Attributes:
        name: "samples", the option, or as "material.s" the parameter; "method.samples" where an option of that name is
            not the budget of its method.
        labels: by key of a cell that of its line.
        n_values: the most that a line has; 1 where nothing is swept.
    """

    name: str
    labels: Mapping[str, Label]
    n_values: int = 1

    @property
    def kind(self) -> str:
        """Of light, material and view the one that is swept; "" for samples and options."""
        kind = self.name.partition(".")[0]
        return kind if kind in CONDITIONS and "." in self.name else ""

    @property
    def parameter(self) -> str:
        """The name of the number in its light, material, view or method."""
        return self.name.removeprefix(f"{self.kind or 'method'}.")

    @property
    def full_name(self) -> str:
        """With what it is of in front: "material.alpha", "method.regions"; and "samples"."""
        return self.name if self.name == SAMPLES or self.kind else f"method.{self.parameter}"

    @property
    def title(self) -> str:
        """As an axis has it."""
        if self.name == SAMPLES:
            return "light samples a pixel"
        return f"{self.parameter} of the {self.kind}" if self.kind else self.parameter

    def value(self, row: Mapping[str, Any]) -> float | None:
        """Of a cell; None where it has no such number."""
        return read_number(
            row["n_samples"] if self.name == SAMPLES else _read_options(row, self.kind).get(self.parameter)
        )

    def point(self, row: Mapping[str, Any]) -> tuple[int, Any]:
        """What the same cell under another light has in common with it: its line and what was asked of it."""
        asked: Any = self.value(row)
        if self.name == SAMPLES:
            budget = read_budget(row)
            asked = asked if budget is None else budget
        elif not self.kind and _is_tuned(row, self.parameter):
            asked = "tuned"  # its value is another under each light
        return self.labels[row["key"]].index, asked


class Place(NamedTuple):
    """Where lines are compared: one condition, or the mean over several lights.

    Attributes:
        lights: of each light its groups: one, or where a parameter is swept those that differ in nothing else.
    """

    title: str
    sweep: Sweep
    lights: Sequence[Sequence[Group]]

    @property
    def groups(self) -> list[Group]:
        """All of them."""
        return [group for groups in self.lights for group in groups]


def find_sweeps(groups: Sequence[Group], claims: Iterable[Mapping[str, Any]] = ()) -> dict[str, Sweep]:
    """By name what a study sweeps, and samples in any case; first what a report shows unasked.

    That is, of what has three values or more, what the study's claims fit a slope over; else samples; else what has the
    most, where it leaves no method out.
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
    """Those that a name may mean: "samples", a full name such as material.alpha, or the number's own, alpha."""
    known = list(sweeps)
    exact = [sweep for sweep in known if name == sweep.full_name]
    return exact or [sweep for sweep in known if sweep.name != SAMPLES and name == sweep.parameter]


def with_costs(sweeps: Mapping[str, Sweep]) -> list[Sweep]:
    """Those along whose lines errors are plotted against costs: under one condition, and none of samples held fixed."""
    is_budgeted = sweeps[SAMPLES].n_values > 1
    return [
        sweep
        for sweep in sweeps.values()
        if not sweep.kind
        and not (is_budgeted and any(label.budget in label.options for label in sweep.labels.values()))
    ]


def find_places(groups: Sequence[Group], sweep: Sweep) -> list[Place]:
    """Groups by what else than the swept quantity they are of, and means over the lights of each material and view."""
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
    """Options and parameters that have more than one number; none that was tuned."""
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
    """By key of each cell the label of its line, which is a method with the options that tell it from others.

    Beside lines that are named by their budgets, the sole budget of a method is in its name, too.
    """
    cells = sorted((cell for group in groups for cell in group.cells), key=lambda cell: cell.index)
    rows = [cell.row for cell in cells]
    names: dict[str, str] = {}  # by key of a cell
    lines: dict[str, tuple[str, dict[str, str], str]] = {}  # by name the method, the options and the budget
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
    """The option that divides lines the most evenly: no value of it has as many lines as one of another option."""
    keys = dict.fromkeys(key for line in lines for key in line)
    most = {key: max(Counter(line.get(key) for line in lines).values()) for key in keys}
    return min(most, key=lambda key: most[key], default="")


def _is_tuned(row: Mapping[str, Any], option: str) -> bool:
    return read_stated(row).get(option) != row["options"].get(option)


def _n_values(place: Place) -> int:
    """The most values of the swept quantity that a line has at a place."""
    values: dict[int, set[float]] = {}
    for group in place.lights[0]:
        for cell in group.done:
            value = place.sweep.value(cell.row)
            if value is not None:
                values.setdefault(place.sweep.point(cell.row)[0], set()).add(value)
    return max(map(len, values.values()), default=0)
