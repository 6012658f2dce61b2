"""The PDF report of a study: the contents of the page, for print, read from the files of the run."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import yaml
from matplotlib.figure import Figure

from glossbench.findings.costs import COSTS
from glossbench.run.figures import FIGURES
from glossbench.run.results import Results
from glossbench.study.labels import format_options

from ..model.axes import FEWEST, SAMPLES, Place, Sweep, with_costs
from ..model.descriptions import INSTALLED, MethodText, define_metrics, describe_methods
from ..model.facts import MissingCell, compose_headline, list_provenance, without_image
from ..model.notation import split_runs
from ..model.panels import Panels, select_shown
from ..model.report import Report
from ..model.selection import MOST_PICTURES, choose_cells, choose_middle_budgets, pick_evenly
from ..typesetting import Press
from .images import PrintedGroup, choose_best_few
from .plots import draw, select_comparable, split_facets
from .tables import make_cost_table, make_error_tables, print_claim, print_decision, print_equal, print_references

MOST_WITHOUT = 100  # cells without an image that are listed one by one
MANY_CELLS = 60  # with more, the tables of all cells move to the appendix
MOST_SWEPT = 12  # places of one sweep that are plotted
MANY_PLACES = 4  # with more, plots of single places move to the appendix
MOST_LATER = 16  # places in the appendix
PLUG_IN = "defined by a plug-in"
Titled = tuple[Figure, str]


def write_report(where: Path | str) -> Path | str:
    """Write report.pdf to the store of results, whole or not at all, and return its path or address."""
    results = Results(where)
    results.disk.own("report.pdf")
    report = Report.from_results(results)
    study, metrics, missing = report.study, report.metrics, without_image(report)
    with Press() as press:
        answer, images = _arrange_images(report, press)
        plots, more_plots = _arrange_plots(report, press)
        errors, *more_errors = make_error_tables(report)
        data = {
            "title": str(study.get("title", "")),
            "source": str(study.get("source") or ""),
            "question": " ".join(str(study.get("question") or "").split()),
            "facts": compose_headline(report),
            "claims": [{"text": c["text"], "verdict": c["verdict"], "summary": c.get("summary", "")}
                       for c in report.claims],
            "verdict_words": _to_words(report.verdict_words),
            "table_words": _to_words(report.table_words),
            "method": report.sole_method,
            "answer": answer,
            "decision": print_decision(report),
            "errors": errors,
            "more_errors": more_errors,
            "tables_last": len(report.rows) > MANY_CELLS,
            "costs": make_cost_table(report),
            "plots": plots,
            "more_plots": more_plots,
            "equal": _make_equal(report),
            "images": images,
            "methods": _describe_methods(describe_methods(report.list_values("method"), report.descriptions), press),
            "installed_note": "" if report.descriptions.is_of_run else INSTALLED,
            "metrics": [each._asdict() | {"formula": split_runs(each.formula or PLUG_IN)}
                        for each in define_metrics(metrics, report.descriptions)],
            "references": print_references(report),
            "without_image": _without_image(missing),
            "n_without_image": len(missing),
            "numbers": [print_claim(claim) for claim in report.claims if claim.get("numbers")],
            "bibliography": _write_bibliography(report, press),
            "study": yaml.safe_dump(study, sort_keys=False, allow_unicode=True, width=112, default_flow_style=None),
            "provenance": [{"name": name, "value": value} for name, value in list_provenance(report)],
        }  # fmt: skip
        pdf = press.pages("report.typ", data)
    results.store.put("report.pdf", pdf)
    return results.store.locate("report.pdf")


def _arrange_images(report: Report, press: Press) -> tuple[dict[str, Any] | None, list[dict[str, Any]]]:
    """The figure of the answer; and for each group the whole images and, unless the answer shows them, crops."""
    metric = report.metrics[0] if report.metrics else None
    answer = report.answer if metric else None
    first, found = None, []
    for group, cells in zip(report.groups, choose_cells(report.groups, MOST_PICTURES), strict=True):
        if not group.done:
            continue
        printed = PrintedGroup(report.results, group, press)
        crops = None
        if answer is not None and answer.group is group:
            first = printed.arrange_crops(answer.cells)
        else:
            few = choose_best_few(group, metric)
            crops = printed.arrange_crops(few) | {"n_shown": len(few), "n_lines": len(choose_middle_budgets(group))}
        found.append({"whole": printed.arrange_whole(cells), "crops": crops, "left_out": len(group.done) - len(cells)})
    return first, found


def _arrange_plots(report: Report, press: Press) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """(plots of the report, plots of the appendix).

    The study's first metric and costs over its first sweep, the metric over each swept parameter, and all figures of
    the metric at each place. If there are many places, their plots move to the appendix, which shows some, evenly; for
    a swept parameter only those of the first place are shown.
    """
    if not report.metrics:
        return [], []
    first = next(iter(report.axes.values()))
    axis = with_costs(report.axes)[0]
    places, later, of = report.places(axis), list[Place](), ""
    if len(places) > MANY_PLACES and first.kind:
        of = f", the first of {len(places)} conditions of the study"
        places = places[:1]
    elif len(places) > MANY_PLACES:
        singles, means = ([p for p in places if (len(p.lights) > 1) == is_mean] for is_mean in (False, True))
        places, later = (means, singles) if 0 < len(means) <= MANY_PLACES else (places[:1], places[1:])
    parameters = [each for each in report.axes.values() if each.kind and each.n_values >= FEWEST and each is not first]
    # One figure after the other: many at once need a GB.
    swept = (each for axis in (first, *parameters) for each in _plot_over_axis(report, axis))
    shown = chain(swept, _plot_at(report, places, of), _plot_over_all(report, axis))
    few = pick_evenly(later, MOST_LATER)
    of_later = f", one of {len(few)} of {len(later)} conditions; the page has all" if len(few) < len(later) else ""
    return _print_figures(shown, press), _print_figures(_plot_at(report, few, of_later), press)


def _plot_over_axis(report: Report, axis: Sweep) -> Iterator[Titled]:
    """Convergence over a sweep other than samples; for an option, which changes costs, also the costs."""
    places, metric = report.places(axis) if axis.name != SAMPLES else [], report.metrics[0]
    left = f", the last of {MOST_SWEPT} of {len(places)} conditions of the study" if len(places) > MOST_SWEPT else ""
    for i, place in enumerate(places[:MOST_SWEPT], 1):
        metrics = [metric] if axis.kind else [metric, *COSTS]
        drawn = [_make_panels("convergence", report, metric=each, over=axis, group=place) for each in metrics]
        panels = [panel for each in drawn for panel in each.panels if not panel.is_last_resort and panel.has_points]
        if axis.kind:
            panels = split_facets(panels)
        if panels:
            of = left if i == MOST_SWEPT else ""
            what = metric if axis.kind else f"{metric} and costs"
            yield draw(panels), f"{place.title}{of}: {what} over {axis.title}"


def _plot_at(report: Report, places: Sequence[Place], of: str = "") -> Iterator[Titled]:
    """All figures of a metric at each place, side by side, except convergence over other sweeps than samples."""
    for place in places:
        is_above = place.sweep.name != SAMPLES
        names = [name for name in _list_figures("group") if not (is_above and name == "convergence")]
        drawn = [_make_panels(name, report, metric=report.metrics[0], over=place.sweep, group=place) for name in names]
        panels = select_shown([panel for each in drawn for panel in select_comparable(each.panels)])
        if panels:
            titles = dict.fromkeys(each.title for each in drawn if any(panel in panels for panel in each.panels))
            yield draw(panels), f"{place.title}{of}: {report.metrics[0]} {' and '.join(titles)}"


def _plot_over_all(report: Report, axis: Sweep) -> Iterator[Titled]:
    """Each figure of a metric that needs no place."""
    for name in [name for name in FIGURES.names() if name not in _list_figures("group")]:
        drawn = _make_panels(name, report, metric=report.metrics[0], over=axis)
        if panels := select_comparable(drawn.panels):
            yield draw(panels), f"{report.metrics[0]} {drawn.title}"


def _list_figures(option: str) -> list[str]:
    """The figures that have an option."""
    return [name for name in FIGURES.names() if option in FIGURES.get(name).options]


def _make_panels(name: str, report: Report, **given: Any) -> Panels:
    """The panels of a figure; none if it is not shown in reports, or needs other options."""
    figure = FIGURES.get(name)()
    return figure.data(report, **given) if figure.in_reports and set(figure.options) <= set(given) else Panels()


def _print_figures(figures: Iterable[Titled], press: Press) -> list[dict[str, Any]]:
    return [press.figure(figure) | {"alt": f"Plots of {title}", "caption": title} for figure, title in figures]


def _make_equal(report: Report) -> list[dict[str, Any]]:
    """Tables of equal time and equal error of each place with two comparable lines; of many places, the means."""
    found = [each for each in report.equal if each.metric == next(iter(report.metrics), None)]
    if len(report.places(report.axes[SAMPLES])) > MOST_SWEPT:
        found = [each for each in found if len(each.place.lights) > 1] or found
    return [table for each in found[:MOST_SWEPT] for table in print_equal(each)]


def _write_bibliography(report: Report, press: Press) -> str | None:
    """The file of the cited works; None if there are none."""
    return press.add("\n".join(c.bibtex for c in report.citations).encode(), "bib") if report.citations else None


def _describe_methods(methods: Sequence[MethodText], press: Press) -> list[dict[str, Any]]:
    """Descriptions of methods; an equation that typst cannot set is printed as plain text."""
    return [each._asdict() | {"is_set": press.is_equation(each.equation)} for each in methods]


def _to_words(said: Mapping[str, str]) -> list[dict[str, str]]:
    return [{"name": name, "text": text} for name, text in said.items()]


def _without_image(missing: Sequence[MissingCell]) -> list[dict[str, Any]]:
    """Skipped cells with their reasons, failed ones with their tracebacks."""
    return [
        {"name": each.cell.row["method"], "options": each.cell.options or format_options(each.cell.row["options"]),
         "place": each.group.title, "status": each.cell.row["status"], "reason": each.reason}
        for each in missing[:MOST_WITHOUT]
    ]  # fmt: skip
