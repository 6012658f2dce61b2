"""The report of a study: all that page, print and single figures show, computed once from the files of a run."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import pandas

from glossbench.columns import parse_row
from glossbench.findings.citations import Citation, collect_citations_of_sources
from glossbench.findings.columns import Column, collect_columns, make_metric_column
from glossbench.findings.decisions import Choices, Need, choose
from glossbench.findings.descriptions import Descriptions, describe
from glossbench.findings.estimates import Estimate, estimate_metric
from glossbench.findings.legends import explain_table, explain_verdicts
from glossbench.findings.trials import read_trials
from glossbench.metrics import METRICS
from glossbench.run.results import Results
from glossbench.study.registries import REGISTRIES

from .answer import Answer, find_answer, list_claimed
from .axes import SAMPLES, Place, Sweep, find_places, find_sweeps
from .conditions import Group, find_sole_method, group_cells
from .equal import EqualTables, make_equal_tables
from .lines import MeasuredLine, measure_lines
from .times import time_notes

KINDS = ("method", "material", "light", "view")


@dataclass(frozen=True, eq=False)
class Report:
    """The results of a run, read from disk and put in order.

    Attributes:
        results: the folder, for images.
        study: the resolved study.
        claims: the verdicts.
        provenance: versions, hardware, times.
        remarks: sentences about incomplete results.
        cells: the table of all cells, as the folder holds it.
        rows: the rows of all cells; JSON columns parsed, missing values None.
        metrics: the metrics of the study that the results have.
        measured: these metrics, and all others that the results have.
        columns: the columns of the results, by name, as the run recorded them.
        groups: the cells by light, material and view.
    """

    results: Results
    study: Mapping[str, Any]
    claims: Sequence[Mapping[str, Any]]
    provenance: Mapping[str, Any]
    remarks: Sequence[str]
    cells: pandas.DataFrame
    rows: Sequence[dict[str, Any]]
    metrics: Sequence[str]
    measured: Sequence[str]
    columns: Mapping[str, Column]
    groups: Sequence[Group]
    _places: dict[str, list[Place]] = field(default_factory=dict)
    _estimates: dict[tuple[str, str], Estimate] = field(default_factory=dict)
    _lines: dict[tuple[int, str], list[MeasuredLine]] = field(default_factory=dict)
    _choices: dict[str, Choices] = field(default_factory=dict)

    @classmethod
    def from_results(cls, results: Results) -> "Report":
        """The report of results, finished or not."""
        study, cells = results.study, results.cells
        rows = [parse_row(row) for row in cells.to_dict("records")]
        metrics = [name for name in results.metrics if name in cells.columns]
        columns = collect_columns(study.get("metrics") or ()) | results.columns
        others = [name for name in METRICS.names() if name in cells.columns]
        measured = list(dict.fromkeys([*metrics, *others]))
        columns |= {name: make_metric_column(name) for name in measured if name not in columns}
        return cls(
            results, study, results.claims, results.provenance, results.remarks(cells), cells, rows, metrics,
            measured, columns, group_cells(rows, [columns[name] for name in measured]),
        )  # fmt: skip

    @cached_property
    def descriptions(self) -> Descriptions:
        """The descriptions that the run recorded; of other things in the table, those of the installed classes."""
        known = self.results.descriptions
        others = [(kind, name) for kind, name in self._used if known.find(kind, name) is None]
        installed = [(kind, name) for kind, name in others if name in REGISTRIES[kind].names()]
        more = (describe(kind, REGISTRIES[kind].get(name)) for kind, name in installed)
        return replace(known, described=(*known.described, *more))

    @cached_property
    def _used(self) -> list[tuple[str, str]]:
        """(kind, name) of all methods, materials, lights, views and metrics of the results, methods first."""
        used = [(kind, name) for kind in KINDS for name in self.list_values(kind)]
        return used + [("metric", name) for name in self.measured]

    @cached_property
    def done(self) -> list[Group]:
        """The groups that have an image."""
        return [group for group in self.groups if group.done]

    @cached_property
    def axes(self) -> dict[str, Sweep]:
        """The sweeps of the study by name; the first is the default axis."""
        return find_sweeps(self.done, self.study.get("claims") or ())

    def places(self, axis: Sweep) -> list[Place]:
        """Where lines over this axis are compared."""
        if axis.name not in self._places:
            self._places[axis.name] = find_places(self.done, axis)
        return self._places[axis.name]

    def lines(self, place: Place, metric: str) -> list[MeasuredLine]:
        """The lines of a metric at a place."""
        key = id(place), metric  # places are made once and live as long as the report
        if key not in self._lines:
            self._lines[key] = measure_lines(place, metric, self.estimate)
        return self._lines[key]

    def estimate(self, row: Mapping[str, Any], metric: str) -> Estimate:
        """A metric of a cell with its uncertainty."""
        key = row["key"], metric
        if key not in self._estimates:
            self._estimates[key] = estimate_metric(row, metric)
        return self._estimates[key]

    def choices(self, metric: str) -> Choices:
        """The configurations that can be compared over all conditions, by a metric."""
        if metric not in self._choices:
            self._choices[metric] = choose(read_trials(self.rows, metric), Need())
        return self._choices[metric]

    @cached_property
    def sole_method(self) -> str:
        """The method of all cells; "" if there are several methods."""
        return find_sole_method(self.groups)

    @cached_property
    def answer(self) -> Answer | None:
        """The cells of the picture on the first page, for the study's first metric."""
        return self.find_answer(self.measured[0]) if self.measured else None

    def find_answer(self, metric: str) -> Answer | None:
        """The same for another metric."""
        return find_answer(self.done, metric, list_claimed(self.study, self.cells))

    @cached_property
    def equal(self) -> list[EqualTables]:
        """Tables of equal time and equal error, for each place over samples and each metric with two such lines."""
        places = self.places(self.axes[SAMPLES])
        return [
            found
            for i, place in enumerate(places, 1)
            for metric in self.measured
            if (found := make_equal_tables(i, place, metric, self.lines(place, metric)))
        ]

    @cached_property
    def citations(self) -> list[Citation]:
        """The literature for all that the study uses."""
        used = [(kind, name) for kind, name in self._used if kind != "metric" or name in self.metrics]
        known = [(name, self.descriptions.find(kind, name)) for kind, name in used]
        sources = [(name, found.source) for name, found in known if found]
        return collect_citations_of_sources(sources, str(self.study.get("source") or ""), self.descriptions.references)

    @cached_property
    def verdict_words(self) -> dict[str, str]:
        """The meaning of words in verdicts."""
        return explain_verdicts(self.claims)

    @cached_property
    def table_words(self) -> dict[str, str]:
        """The meaning of words in tables."""
        return explain_table(self.rows, descriptions=self.descriptions)

    @cached_property
    def time_notes(self) -> list[str]:
        """Remarks on how times were measured."""
        return time_notes(self.rows)

    def list_values(self, column: str) -> list[str]:
        """Different values of a column, in order."""
        return list(dict.fromkeys(str(row[column]) for row in self.rows if row.get(column) is not None))
