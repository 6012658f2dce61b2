"""The decision of a report: ranks of methods at equal budgets, Pareto fronts in numbers, and which method to take."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from glossbench.columns import CONDITIONS
from glossbench.findings.costs import COSTS, NEGLIGIBLE
from glossbench.findings.decisions import LIGHT, Choice, Choices, Need, choose
from glossbench.findings.fronts import find_fronts
from glossbench.findings.ranks import Mean, average, draw_weights, rank
from glossbench.findings.trials import Mask, Trials
from glossbench.shading.method import CHANGES

from ..style import format_number
from .report import Report
from .selection import pick_evenly
from .table import Entry, Head, Part, Row, Table

MOST_BUDGETS = 4
TAKE = (
    "From: with less time, take the line above. A line is here only if the 95 % interval of its error over that of the "
    "line above is below 1; times within 20 % count as equal. But: under this light alone, another method that takes "
    "no longer is better in this sense."
)
RANKS = (
    "Rank: mean over the conditions of 1 + the number of lower errors + half the number of errors whose order noise "
    "leaves open; below, its 95 % interval. Bold: no other interval overlaps. Methods without a budget are in each "
    "part. Front: under how many conditions no other configuration of the study, of any budget, has a lower error "
    "beyond noise at a cost that is not higher, or an equal error at a lower cost, where times within 20 % are equal; "
    "below, under which lights, if not under all."
)
FRONTS = {"shade": "time", **{change: change for change in CHANGES}, "memory": "memory"}


@dataclass(frozen=True)
class Decision:
    """What a report says about which method to take, by one metric.

    Attributes:
        table: the choice for each change and time.
        ranks: ranks at equal budgets, and on which fronts a configuration is.
        explained: how to read the first table, and where its numbers come from.
    """

    table: Table
    ranks: Table
    explained: str


def decide(report: Report) -> Decision | None:
    """The decision by the first error of the study; None if no two methods can be compared."""
    errors = [name for name in report.metrics if report.columns[name].lower_is_better]
    if not errors:
        return None
    choices = report.choices(errors[0])
    if not has_choice(choices):
        return None
    explained = " ".join([TAKE, *_list_notes(report, choices)])
    return Decision(_make_decision_table(report, choices), _make_rank_table(report, choices), explained)


def has_choice(choices: Choices) -> bool:
    """Whether two methods, or one method with two sets of options besides the budget, can be compared."""
    return len({each.configuration.line for each in choices.all}) > 1


def _make_decision_table(report: Report, still: Choices) -> Table:
    """For each change of a scene, the choice from each time on."""
    cells = {cell.row["key"]: cell for group in report.groups for cell in group.cells}
    parts = []
    for title, choices in _list_scenes(still):
        rows, before = [], None
        for step in choices.find_steps():
            ratio = _format_mean(choices.compare(step, before)) if before else ""
            split = f"{format_number(step.shade)} + {format_number(step.update)}" if step.update else ""
            entries = [
                Entry(format_number(step.milliseconds), split),
                Entry(format_number(choices.mean_error(step)), ratio and f"× {ratio}"),
                Entry(format_number(step.megabytes)),
                Entry(_shorten(report, _describe_splits(choices, step))),
            ]
            cell = cells[step.configuration.cells[step.slowest][0]["key"]]
            rows.append(Row([_shorten(report, step.configuration.name)], entries, cell=cell))
            before = step
        parts.append(Part(title, rows))
    metric = report.columns[still.trials.metric]
    heads = [Head("from", "ms"), Head(metric.title, metric.unit), Head("state", "MB"), Head("but", is_number=False)]
    if not any(row.entries[-1].text for part in parts for row in part.rows):
        heads = heads[:-1]
        parts = [part._replace(rows=[row._replace(entries=row.entries[:-1]) for row in part.rows]) for part in parts]
    return Table([Head("take", is_number=False)], heads, parts)


def _list_scenes(still: Choices) -> Iterator[tuple[str, Choices]]:
    """What may change in each frame, with the choices; changes with the same times are told together."""
    scenes = {"nothing": still} | {f"your {each}": choose(still.trials, Need(changes=(each,))) for each in CHANGES}
    alike: dict[tuple[tuple[str, float], ...], list[str]] = {}
    for name, choices in scenes.items():
        alike.setdefault(_list_times(choices), []).append(name)
    for times, names in alike.items():
        if times:
            *others, last = names
            told = f"{', '.join(others)} or {last}" if others else last
            yield f"{told} changes in each frame".capitalize(), scenes[names[0]]


def _list_times(choices: Choices) -> tuple[tuple[str, float], ...]:
    return tuple((each.configuration.name, each.milliseconds) for each in choices.all)


def _describe_splits(choices: Choices, step: Choice) -> str:
    """Under which lights alone another choice of at most this time is better, and which."""
    lights = [each.names[LIGHT] for each in choices.trials.conditions]
    need = replace(choices.need, milliseconds=step.milliseconds)
    found: dict[str, list[str]] = {}
    for light in dict.fromkeys(lights) if len(set(lights)) > 1 else ():
        own = choose(choices.trials, need, [n for n in choices.places if lights[n] == light])
        same = next(each for each in own.fitting if each.index == step.index)
        if own.is_better(own.fitting[0], same):
            found.setdefault(own.fitting[0].configuration.name, []).append(light)
    return "; ".join(f"{_join(names)}: {name}" for name, names in found.items())


def _make_rank_table(report: Report, choices: Choices) -> Table:
    """One part for each budget; methods without a budget are in all parts."""
    trials, members = choices.trials, choices.all
    budgets = sorted({each.configuration.budget for each in members if each.configuration.budget is not None})
    costs = [cost for cost in COSTS if (np.nan_to_num(trials.cost(cost)) >= NEGLIGIBLE[cost]).any()]
    fronts = {cost: find_fronts(trials, cost) for cost in costs}
    weights = draw_weights(trials.conditions)
    parts = []
    shown: list[float | None] = [*pick_evenly(budgets, MOST_BUDGETS)] or [None]
    for budget in shown:
        own = [each for each in members if each.configuration.budget in (None, budget)]
        if len(own) > 1:
            title = f"budget {budget:g}" if budget is not None else ""
            ranks = average(rank(trials.orders, [each.index for each in own]), weights)
            parts.append(Part(title, _list_ranks(report, choices, own, ranks, fronts)))
    heads = [Head("rank"), Head(trials.metric), *(Head(FRONTS[cost], group="front", is_number=False) for cost in costs)]
    return Table([Head("method", is_number=False)], heads, parts)


def _list_ranks(
    report: Report, choices: Choices, own: Sequence[Choice], ranks: Sequence[Mean], fronts: Mapping[str, Mask]
) -> list[Row]:
    rows = []
    lowest, *others = sorted(ranks, key=lambda each: each.value)
    for each, mean in sorted(zip(own, ranks, strict=True), key=lambda pair: pair[1].value):
        is_best = mean is lowest and all(mean.high < other.low for other in others)
        interval = f"{format_number(mean.low, 2)} to {format_number(mean.high, 2)}" if mean.low < mean.high else ""
        entries = [
            Entry(format_number(mean.value, 2), interval, is_best),
            Entry(format_number(choices.mean_error(each))),
        ]
        entries += [_describe_front(choices.trials, front[each.index]) for front in fronts.values()]
        rows.append(Row([_shorten(report, each.configuration.name)], entries))
    return rows


def _describe_front(trials: Trials, is_on: Mask) -> Entry:
    """Under how many conditions a configuration is on a front; if not under all, under which lights it is."""
    n, of = int(is_on.sum()), len(is_on)
    if n in (0, of):
        return Entry("–" if n == 0 else f"all {of}" if of > 1 else "yes")
    lights: dict[str, list[bool]] = {}
    for condition, on in zip(trials.conditions, is_on, strict=True):
        lights.setdefault(condition.names[LIGHT], []).append(bool(on))
    every, partly = ([light for light, on in lights.items() if rule(on)] for rule in (all, _is_mixed))
    told = [f"{_join(every)}"] if every else []
    told += [f"partly {_join(partly)}"] if partly else []
    return Entry(f"{n} of {of}", "; ".join(told) if len(lights) > 1 else "")


def _shorten(report: Report, text: str) -> str:
    """A text with the names of configurations; of a single method only the options are left."""
    return re.sub(rf"\b{re.escape(report.sole_method)} \((.*?)\)", r"\1", text) if report.sole_method else text


def _is_mixed(on: Sequence[bool]) -> bool:
    return any(on) and not all(on)


def _join(names: Sequence[str]) -> str:
    return ", ".join(names) if len(names) <= 3 else f"{len(names)} lights"


def _format_mean(mean: Mean) -> str:
    return f"{format_number(mean.value, 2)} [{format_number(mean.low, 2)}, {format_number(mean.high, 2)}]"


def _list_notes(report: Report, choices: Choices) -> list[str]:
    """Where errors, times and intervals come from, and what is not compared."""
    conditions = choices.trials.conditions
    counts = {kind: len({each.keys[at] for each in conditions}) for at, kind in enumerate(CONDITIONS)}
    over = ", ".join(f"{n} {kind}{'s' if n > 1 else ''}" for kind, n in counts.items())
    machines = ", ".join(report.list_values("processor")) or "an unknown processor"
    notes = [
        f"Errors are geometric means over {len(conditions)} conditions ({over}); × is the ratio to the line above, "
        "with its 95 % interval by a bootstrap over lights, materials and views, and by the noise of the references.",
        f"Times are those of one frame, shading and what a change makes necessary again, the largest over the "
        f"conditions, at the measured sizes of the views on {machines}.",
    ]
    if 1 < max(counts.values()) <= 3:
        notes.append("With three or fewer lights, materials and views the intervals over conditions are only a hint.")
    if any(each.is_stated for each in choices.all):
        stated = [each.configuration.name for each in choices.all if each.is_stated]
        notes.append(f"The times of {', '.join(stated)} were stated by their author, not measured.")
    if choices.left_out:
        names = list(choices.left_out)
        more = f" and {len(names) - 5} more" if len(names) > 5 else ""
        notes.append(f"Not compared, because an image or a time is missing: {', '.join(names[:5])}{more}.")
    return notes
