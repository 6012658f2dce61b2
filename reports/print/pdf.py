"""The PDF report of a study: the same as the page, for print, read from what the run left on disk."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import yaml
from matplotlib.figure import Figure

from glossbench.atomic import replacing
from glossbench.findings.citations import cited_by
from glossbench.findings.legends import explain_table, explain_verdicts
from glossbench.metrics import METRICS
from glossbench.run.results import Results
from glossbench.study.labels import listed, parsed

from ..model.answer import answer_of, claimed
from ..model.axes import FEWEST, SAMPLES, Place, Sweep, places_of, sweeps_of, with_costs
from ..model.conditions import Group, grouped, sole_method
from ..model.descriptions import described
from ..model.equal import error_at_time, time_at_error
from ..model.lines import COSTS, axis_of, lines_at
from ..model.notation import runs
from ..model.selection import MOST_PICTURES, chosen, middle_budgets
from ..typesetting import Press
from .images import PrintedGroup, telling_few
from .plots import against_costs, cost_over_sweep, error_by_method, facets, over_sweep, plot
from .tables import claim_table, cost_table, equal_table, error_tables, reference_table

MOST_WITHOUT = 100  # cells without an image that are told one by one
MANY_CELLS = 60  # more, and the tables of all cells move to the appendix
MOST_SWEPT = 12  # places of one sweep that are plotted
MANY_PLACES = 4  # more, and plots of single places move to the appendix
Titled = tuple[Figure, str]


def write_report(folder: Path) -> Path:
    """Writes report.pdf into a folder of results, whole or not at all, and returns its path."""
    results = Results(folder)
    results.disk.own("report.pdf")
    study, cells, claims = results.study, results.cells, results.claims
    rows = [parsed(row) for row in cells.to_dict("records")]
    metrics = [name for name in study.get("metrics") or () if name in cells.columns]
    groups = grouped(rows, metrics)
    done = [group for group in groups if group.done]
    sweeps = sweeps_of(done, study.get("claims") or ())
    citations = cited_by(_used(rows, metrics), str(study.get("source") or ""))
    with Press() as press:
        answer, images = _images(results, groups, metrics, press)
        plots, more_plots = _plots(done, sweeps, metrics[0], press) if metrics else ([], [])
        errors, *more_errors = error_tables(groups, metrics)
        data = {
            "title": str(study.get("title", "")),
            "source": str(study.get("source") or ""),
            "question": " ".join(str(study.get("question") or "").split()),
            "facts": [*_facts(results.provenance, rows), *results.remarks(cells)],
            "claims": [{"text": c["text"], "verdict": c["verdict"], "summary": c.get("summary", "")} for c in claims],
            "verdict_words": _words(explain_verdicts(claims)),
            "table_words": _words(explain_table(rows)),
            "method": sole_method(groups),
            "answer": answer,
            "errors": errors,
            "more_errors": more_errors,
            "tables_last": len(rows) > MANY_CELLS,
            "costs": cost_table(groups),
            "plots": plots,
            "more_plots": more_plots,
            "equal": _equal(places_of(done, sweeps[SAMPLES]), metrics[0]) if metrics else [],
            "images": images,
            "methods": _methods(rows, press),
            "metrics": [_metric(name) for name in metrics],
            "references": reference_table(groups),
            "without_image": _without_image(groups),
            "n_without_image": sum(not cell.done for group in groups for cell in group.cells),
            "numbers": [claim_table(claim) for claim in claims if claim.get("numbers")],
            "bibliography": press.add("\n".join(c.bibtex for c in citations).encode(), "bib") if citations else None,
            "study": yaml.safe_dump(study, sort_keys=False, allow_unicode=True, width=112, default_flow_style=None),
            "provenance": _provenance(results.provenance, study, groups),
        }
        pdf = press.pages("report.typ", data)
    path = results.disk.path("report.pdf")
    with replacing(path) as part:
        part.write_bytes(pdf)
    return path


def _images(
    results: Results, groups: Sequence[Group], metrics: Sequence[str], press: Press
) -> tuple[dict[str, Any] | None, list[dict[str, Any]]]:
    """The figure of the answer; and of each group the whole images and, unless it is the answer's, crops."""
    answer = answer_of(groups, metrics[0], claimed(results)) if metrics else None
    first, found = None, []
    for group, cells in zip(groups, chosen(groups, MOST_PICTURES), strict=True):
        if not group.done:
            continue
        printed = PrintedGroup(results, group, press)
        crops = None
        if answer is not None and answer.group is group:
            first = printed.crops(answer.cells)
        else:
            few = telling_few(group, metrics[0] if metrics else None)
            crops = printed.crops(few) | {"n_shown": len(few), "n_lines": len(middle_budgets(group))}
        found.append({"whole": printed.whole(cells), "crops": crops, "left_out": len(group.done) - len(cells)})
    return first, found


def _plots(
    groups: Sequence[Group], sweeps: Mapping[str, Sweep], metric: str, press: Press
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """The study's first metric, and costs, over what the study sweeps first, and the metric over each parameter that it
    sweeps; and at each place the metric against costs.

    Second, for the appendix, those of many places. Along a swept parameter the first of many places stands for all.
    """
    first = next(iter(sweeps.values()))
    places, later, of = places_of(groups, with_costs(sweeps)[0]), list[Place](), ""
    if len(places) > MANY_PLACES and first.kind:
        of = f", the first of {len(places)} conditions of the study"
        places = places[:1]
    elif len(places) > MANY_PLACES:
        singles, means = ([p for p in places if (len(p.lights) > 1) == is_mean] for is_mean in (False, True))
        places, later = (means, singles) if 0 < len(means) <= MANY_PLACES else (places[:1], places[1:])
    parameters = [sweep for sweep in sweeps.values() if sweep.kind and sweep.n_values >= FEWEST and sweep is not first]
    # One figure after the other: many at once take a GB.
    swept = (each for sweep in (first, *parameters) for each in _over_sweep(groups, sweep, metric))
    shown = chain(swept, _at(places, metric, of))
    return _printed(shown, press), _printed(_at(later, metric), press)


def _over_sweep(groups: Sequence[Group], sweep: Sweep, metric: str) -> Iterator[Titled]:
    places = places_of(groups, sweep) if sweep.name != SAMPLES else []
    left = f", the last of {MOST_SWEPT} of {len(places)} conditions of the study" if len(places) > MOST_SWEPT else ""
    for i, place in enumerate(places[:MOST_SWEPT], 1):
        panels = over_sweep(place, metric)
        what = metric
        if panels and sweep.kind:
            panels = facets(panels)
        elif panels:  # what a method is told changes its costs
            panels += [panel for cost in COSTS for panel in cost_over_sweep(place, metric, cost)]
            what = f"{metric} and costs"
        if panels:
            of = left if i == MOST_SWEPT else ""
            yield plot(panels), f"{place.title}{of}: {what} over {sweep.title}"


def _at(places: Sequence[Place], metric: str, of: str = "") -> Iterator[Titled]:
    """A metric over samples and costs; where each method has one budget and no cost, by method."""
    for place in places:
        lines = lines_at(place, metric)
        over = over_sweep(place, metric) if place.sweep.name == SAMPLES else []
        if panels := [*over, *against_costs(place, metric)]:
            what = "over samples and costs" if over else "against costs"
            yield plot(panels), f"{place.title}{of}: {metric} {what}"
        elif lines:
            figure = error_by_method(lines, axis_of(place, metric))
            yield figure, f"{place.title}{of}: {metric} by method"


def _printed(figures: Iterable[Titled], press: Press) -> list[dict[str, Any]]:
    return [press.figure(figure) | {"alt": f"Plots of {title}", "caption": title} for figure, title in figures]


def _equal(places: Sequence[Place], metric: str) -> list[dict[str, Any]]:
    """Tables of equal time and equal error of each place, where two lines can be compared; of many places the means."""
    found = []
    if len(places) > MOST_SWEPT:
        places = [place for place in places if len(place.lights) > 1] or places
    for place in places[:MOST_SWEPT]:
        lines, axis = lines_at(place, metric), axis_of(place, metric)
        if by_time := error_at_time(lines, axis):
            found.append(equal_table(by_time, f"{place.title}: {axis.label} at equal shading time", "ms"))
        if by_error := time_at_error(lines, axis):
            found.append(equal_table(by_error, f"{place.title}: shading time [ms] at equal {axis.label}", ""))
    return found


def _used(rows: Sequence[Mapping[str, Any]], metrics: Sequence[str]) -> list[tuple[str, str]]:
    """(kind, name) of all that a study is made of, methods first."""
    found = {(kind, str(row[kind])): None for kind in ("method", "material", "light", "view") for row in rows}
    return [*found, *(("metric", name) for name in metrics)]


def _methods(rows: Sequence[Mapping[str, Any]], press: Press) -> list[dict[str, Any]]:
    """Methods in words; an equation that cannot be set is printed as it was written."""
    return [
        each._asdict() | {"is_set": press.is_equation(each.equation)}
        for each in described([row["method"] for row in rows])
    ]


def _words(said: Mapping[str, str]) -> list[dict[str, str]]:
    return [{"name": name, "text": text} for name, text in said.items()]


def _metric(name: str) -> dict[str, Any]:
    if name not in METRICS.names():
        return {"name": name, "unit": "", "formula": runs("defined by a plug-in")}
    cls = METRICS.get(name)
    return {"name": name, "unit": cls.unit.replace("1", ""), "formula": runs(cls.formula)}


def _without_image(groups: Sequence[Group]) -> list[dict[str, Any]]:
    """Skipped cells with their reasons, failed ones with their tracebacks."""
    return [
        {"name": cell.row["method"], "options": cell.options or listed(cell.row["options"]), "place": group.title,
         "status": cell.row["status"], "reason": (cell.row["reason"] or "").strip() or "no reason is known"}
        for group in groups
        for cell in group.cells
        if not cell.done
    ][:MOST_WITHOUT]  # fmt: skip


def _facts(provenance: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """One line under the title: with what, when and how much."""
    n_done = sum(row["status"] == "done" for row in rows)
    counts = f"{len(rows)} cells" + ("" if n_done == len(rows) else f", {n_done} of them with an image")
    version, started = provenance.get("glossbench"), str(provenance.get("started", ""))[:10]
    return [text for text in (f"glossbench {version}" if version else "", started, counts) if text]


def _provenance(
    provenance: Mapping[str, Any], study: Mapping[str, Any], groups: Sequence[Group]
) -> list[dict[str, str]]:
    facts = {key.replace("_", " "): listed(v) if isinstance(v, Mapping) else str(v) for key, v in provenance.items()}
    if isinstance(study.get("reference"), Mapping):
        facts["reference"] = listed(study["reference"])
    for group in groups:
        stated = (f"{kind}: {listed(options) or 'no options'}" for kind, options in group.options.items())
        facts[group.title] = "; ".join(stated)
    return [{"name": name, "value": value} for name, value in facts.items()]
