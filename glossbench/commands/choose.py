"""`glossbench choose`: the methods of results that fit a need, best first, and what would change the answer."""

from collections.abc import Iterator, Sequence
from itertools import islice
from math import inf
from typing import TYPE_CHECKING, Annotated, Any

import typer

from glossbench.columns import CONDITIONS, parse_row
from glossbench.commands.completion import complete_from
from glossbench.commands.completion import results as result_folders
from glossbench.commands.printing import note, out, print_rows, print_words, say, warn_of_times
from glossbench.commands.quantities import parse_budget, parse_memory
from glossbench.errors import InputError, suggest_nearest

if TYPE_CHECKING:
    from glossbench.findings.decisions import Choice, Choices
    from glossbench.findings.ranks import Mean
    from glossbench.findings.trials import Trials
    from glossbench.run.results import Results

MOST = 20  # of the lines of one list
WORDS = {
    "times the first": "ratio of errors, a geometric mean over the conditions, with its 95 % interval by a bootstrap "
    "over lights, materials and views, and by the noise of the references",
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
    for remark in opened.remarks(opened.cells):
        note(remark)
    first, *others = _list_metrics(opened, metric)
    trials = _read_trials(opened, first)
    if n_pixels and any(each.n_pixels != each.n_pixels for each in trials.conditions):
        raise InputError(f"{results} does not say how many pixels were timed: leave out ' at ' and the size")
    places = _select(trials, anisotropic)
    choices = find_choices(trials, need, places)
    print_rows(_describe_need(choices, opened, budget, memory))
    warn_of_times(opened.cells)
    _print_choices(choices)
    turns = find_turns(choices, {name: _read_trials(opened, name) for name in others})
    if turns:
        say("What would change the answer:")
    for turn in turns:
        ratio = f", {_format_ratio(turn.ratio)} times the error" if turn.ratio else ""
        say(f"  {turn.when}: {turn.choice.configuration.name}{ratio}; {_format_costs(turn.choice)}")
    print_words(WORDS)


def _list_metrics(results: "Results", asked: str | None) -> list[str]:
    """The errors of which less is better, the asked one first."""
    columns, cells = results.columns, results.cells
    known = [name for name in results.metrics if name in cells and columns[name].lower_is_better]
    if not known:
        raise InputError(f"{results.store.address} has no metric of which less is better")
    if asked is not None and asked not in known:
        raise InputError(f"--metric: no error of these results is called {asked!r}{suggest_nearest(asked, known)}")
    return sorted(known, key=lambda name: name != (asked or known[0]))


def _read_trials(results: "Results", metric: str) -> "Trials":
    from glossbench.findings.trials import read_trials

    rows = [parse_row(row) for row in results.cells.to_dict("records")]
    return read_trials(rows, metric, _count_pixels(results, rows))


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


def _describe_need(choices: "Choices", results: "Results", budget: str | None, memory: str | None) -> dict[str, str]:
    """The need, the conditions, and where times come from."""
    need, trials = choices.need, choices.trials
    asked = [f"new {' and '.join(need.changes)} in each frame" if need.changes else "nothing changes between frames"]
    asked += [f"at most {text}" for text in (budget, memory) if text]
    seen = [trials.conditions[n] for n in choices.places]
    names = [list(dict.fromkeys(each.names[at] for each in seen)) for at in range(len(CONDITIONS))]
    done = results.cells[results.cells["status"] == "done"]
    machines = [
        f"{name} ({device})" for name, device in dict.fromkeys(zip(done["processor"], done["device"], strict=True))
    ]
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
    told = {each.configuration.name: _format_costs(each) for each in choices.all if each not in fitting}
    for title, reasons in (("Too slow or too large", told), ("Not comparable", choices.left_out)):
        for name, reason in islice(reasons.items(), MOST):
            out.print(f"{title}: {name}: {reason}", style="dim", soft_wrap=True, markup=False)
        if len(reasons) > MOST:
            say(f"... and {len(reasons) - MOST} more")
    out.print()


def _format_error(choices: "Choices", choice: "Choice", first: "Choice") -> str:
    text = f"{choices.trials.metric} {choices.mean_error(choice):.3g}"
    if choice is first:
        return text
    ratio = choices.compare(choice, first)
    return f"{text}, {_format_ratio(ratio)} times the first{', like the first' if ratio.low <= 1 <= ratio.high else ''}"


def _format_ratio(ratio: "Mean") -> str:
    return f"{ratio.value:.3g} [{ratio.low:.3g}, {ratio.high:.3g}]"


def _format_costs(choice: "Choice") -> str:
    parts = f" = {choice.shade:.3g} + {choice.update:.3g}" if choice.update else ""
    source = ", stated by its author" if choice.is_stated else ""
    memory = "" if choice.megabytes != choice.megabytes else f", {choice.megabytes:.3g} MB"
    return f"{choice.milliseconds:.3g} ms{parts}{source}{memory}"


def _list_cells(choices: "Choices", choice: "Choice") -> Iterator[str]:
    """The cells of the lowest error, the highest error and the longest time."""
    trials, errors = choices.trials, choices.trials.log_errors[choice.index]
    low, high = (pick(choices.places, key=lambda n: errors[n]) for pick in (min, max))
    for what, n in (("lowest error", low), ("highest error", high), ("slowest", choice.slowest)):
        row = choice.configuration.cells[n][0]
        value = "" if what == "slowest" else f" {row[trials.metric]:.3g}"
        yield f"{what}{value}: {trials.conditions[n].title} (cell {row['key'][:8]})"
