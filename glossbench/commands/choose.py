"""`glossbench choose`: the methods of results that fit a need, best first, and what would change the answer."""

from collections.abc import Iterator, Sequence
from itertools import islice
from math import inf, isnan
from typing import TYPE_CHECKING, Annotated, Any

import typer

from glossbench.columns import CONDITIONS, parse_row
from glossbench.commands.completion import complete_from
from glossbench.commands.completion import results as result_folders
from glossbench.commands.printing import note, out, print_rows, print_words, say, warn_of_times
from glossbench.commands.quantities import parse_budget, parse_memory
from glossbench.errors import InputError, suggest_nearest

if TYPE_CHECKING:
    from pandas import DataFrame

    from glossbench.findings.decisions import Choice, Choices
    from glossbench.findings.ranks import Mean
    from glossbench.findings.trials import Trials
    from glossbench.run.results import Results

MOST = 20  # of the lines of one list
WORDS = {
    "times the first": "ratio of errors, a geometric mean over the conditions, with its 95 % interval by a bootstrap "
    "over lights, materials and views (with three or fewer of each only a hint), and by the noise of the references",
    "like the first": "this interval contains 1",
    "cell": "the beginning of its key in cells.parquet",
}


def choose(
    results: Annotated[str, typer.Argument(help="The folder or address of a run.", autocompletion=result_folders)],
    changes: Annotated[
        list[str] | None,
        typer.Option(
            help="What changes in each frame: light, material, geometry or view; repeatable. Its update counts.",
            autocompletion=complete_from(lambda: ["light", "material", "geometry", "view"]),
        ),
    ] = None,
    anisotropic: Annotated[bool, typer.Option("--anisotropic", help="Only anisotropic materials count.")] = False,
    budget: Annotated[
        str | None, typer.Option(metavar="TIME[ at SIZE]", help='Most time of a frame, such as "1 ms at 128^2".')
    ] = None,
    memory: Annotated[str | None, typer.Option(metavar="SIZE", help="Most memory of the state, such as 4MB.")] = None,
    metric: Annotated[str | None, typer.Option(help="Error metric (default: the study's first).")] = None,
) -> None:
    """Say which methods fit a need, best first, and what would change the answer."""
    from glossbench.findings.decisions import Need
    from glossbench.findings.decisions import choose as find_choices
    from glossbench.findings.trials import read_trials
    from glossbench.findings.turns import find_turns
    from glossbench.run.results import Results
    from glossbench.shading.method import CHANGES

    for change in changes or ():
        if change not in CHANGES:
            raise InputError(f"--changes: nothing that changes is called {change!r}{suggest_nearest(change, CHANGES)}")
    milliseconds, n_pixels = parse_budget(budget) if budget is not None else (inf, None)
    megabytes = parse_memory(memory) if memory is not None else inf
    need = Need(tuple(dict.fromkeys(changes or ())), milliseconds, megabytes, n_pixels)
    opened = Results.open(results)
    cells = opened.cells
    for remark in opened.remarks(cells):
        note(remark)
    rows = [parse_row(row) for row in cells.to_dict("records")]
    pixels = _count_pixels(opened, rows)
    first, *others = [read_trials(rows, name, pixels) for name in _list_metrics(opened, cells, metric)]
    if n_pixels and any(isnan(each.n_pixels) for each in first.conditions):
        raise InputError(f"{results} does not say how many pixels were timed: leave out ' at ' and the size")
    choices = find_choices(first, need, _select(first, anisotropic))
    print_rows(_describe_need(choices, budget, memory))
    warn_of_times(cells)
    _print_choices(choices)
    turns = find_turns(choices, {each.metric: each for each in others})
    if turns:
        say("What would change the answer:")
    for turn in turns:
        ratio = f", {_format_ratio(turn.ratio)} times the error" if turn.ratio else ""
        say(f"  {turn.when}: {turn.choice.configuration.name}{ratio}; {_format_costs(turn.choice)}")
    print_words(WORDS)


def _list_metrics(results: "Results", cells: "DataFrame", asked: str | None) -> list[str]:
    """The errors of which less is better, the asked one first."""
    columns = results.columns
    known = [name for name in results.metrics if name in cells and columns[name].lower_is_better]
    if not known:
        raise InputError(f"{results.store.address} has no metric of which less is better")
    if asked is not None and asked not in known:
        raise InputError(f"--metric: no error of these results is called {asked!r}{suggest_nearest(asked, known)}")
    return sorted(known, key=lambda name: name != (asked or known[0]))


def _count_pixels(results: "Results", rows: Sequence[dict[str, Any]]) -> dict[str, float]:
    keys = {str(row["reference_key"]) for row in rows if row["status"] == "done"}
    return {key: results.mask(key).sum() for key in keys if results.store.has(f"references/{key}_mask.png")}


def _select(trials: "Trials", anisotropic: bool) -> list[int]:
    from glossbench.findings.anisotropic import is_anisotropic

    places = [n for n, each in enumerate(trials.conditions) if not anisotropic or is_anisotropic(each)]
    if not places:
        names = ", ".join(dict.fromkeys(each.names[1] for each in trials.conditions))
        raise InputError(f"--anisotropic: no material of these results is anisotropic: {names}")
    return places


def _describe_need(choices: "Choices", budget: str | None, memory: str | None) -> dict[str, str]:
    """The need, the conditions, and where times come from."""
    need, trials = choices.need, choices.trials
    asked = [f"new {' and '.join(need.changes)} in each frame" if need.changes else "nothing changes between frames"]
    asked += [f"at most {text}" for text in (budget, memory) if text]
    seen = [trials.conditions[n] for n in choices.places]
    names = [list(dict.fromkeys(each.names[at] for each in seen)) for at in range(len(CONDITIONS))]
    rows = [row for each in trials.configurations for own in each.cells.values() for row in own]
    machines = dict.fromkeys(f"{row.get('processor') or 'an unknown processor'} ({row.get('device')})" for row in rows)
    scaled = ""
    if need.n_pixels:
        measured = sorted({round(each.n_pixels) for each in seen})
        span = " to ".join(f"{n:,}" for n in dict.fromkeys((measured[0], measured[-1])))
        scaled = f"; shading times are scaled from {span} to {need.n_pixels:,} pixels, updates are not"
    return {
        "need": "; ".join(asked),
        "conditions": "\n".join(f"{len(own)} {kind}s: {', '.join(own)}" if len(own) > 1 else f"{kind}: {own[0]}"
                                for kind, own in zip(CONDITIONS, names, strict=True)),
        "errors": f"{trials.metric}, the geometric mean over {len(seen)} conditions",
        "times": f"measured on {', '.join(machines)}; the largest over the conditions{scaled}",
    }  # fmt: skip


def _print_choices(choices: "Choices") -> None:
    """The best fitting configuration of each line, and those that do not fit or cannot be compared."""
    fitting = choices.fitting
    best = list({each.configuration.line: each for each in reversed(fitting)}.values())
    best.sort(key=fitting.index)
    if not best:
        say("No method of these results fits.")
    for i, each in enumerate(best[:MOST], 1):
        say(f"{i}. {each.configuration.name}: {_format_error(choices, each, best[0])}; {_format_costs(each)}")
        say(f"   {'; '.join(_list_cells(choices, each))}")
    if len(best) > MOST:
        say(f"... and {len(best) - MOST} more")
    others = sorted((each for each in choices.all if each not in fitting), key=lambda each: each.milliseconds)
    told = {each.configuration.name: _format_costs(each) for each in others}
    for title, reasons in (("Too slow or too large", told), ("Not comparable", choices.left_out)):
        for name, reason in islice(reasons.items(), MOST):
            out.print(f"{title}: {name}: {reason}", style="dim", soft_wrap=True, markup=False)
        if len(reasons) > MOST:
            say(f"... and {len(reasons) - MOST} more")
    out.print()


def _format_error(choices: "Choices", choice: "Choice", first: "Choice") -> str:
    text = f"{choices.trials.metric} {_format(choices.mean_error(choice))}"
    if choice is first:
        return text
    ratio = choices.compare(choice, first)
    return f"{text}, {_format_ratio(ratio)} times the first{', like the first' if ratio.low <= 1 <= ratio.high else ''}"


def _format_ratio(ratio: "Mean") -> str:
    return f"{_format(ratio.value)} [{_format(ratio.low)}, {_format(ratio.high)}]"


def _format_costs(choice: "Choice") -> str:
    parts = f" = {_format(choice.shade)} + {_format(choice.update)}" if choice.update else ""
    source = ", stated by its author" if choice.is_stated else ""
    memory = "" if isnan(choice.megabytes) else f", {_format(choice.megabytes)} MB"
    return f"{_format(choice.milliseconds)} ms{parts}{source}{memory}"


def _format(value: float) -> str:
    return f"{float(f'{value:.3g}'):,g}"


def _list_cells(choices: "Choices", choice: "Choice") -> Iterator[str]:
    """The cells of the lowest error, the highest error and the longest time."""
    trials, errors = choices.trials, choices.trials.log_errors[choice.index]
    low, high = (pick(choices.places, key=lambda n: errors[n]) for pick in (min, max))
    for what, n in (("lowest error", low), ("highest error", high), ("slowest", choice.slowest)):
        row = choice.configuration.cells[n][0]
        value = "" if what == "slowest" else f" {_format(row[trials.metric])}"
        yield f"{what}{value}: {trials.conditions[n].title} (cell {row['key'][:8]})"
