"""The columns of a study's results: those that every cell has, and one for each metric."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

from glossbench.columns import COLUMNS, Column
from glossbench.errors import InputError
from glossbench.metrics import METRICS
from glossbench.metrics.metric import name_columns
from glossbench.study.labels import with_options

__all__ = [
    "COLUMNS",
    "Column",
    "collect_columns",
    "columns_from_json",
    "columns_to_json",
    "list_metric_columns",
    "make_metric_column",
    "read_metric_options",
]


def make_metric_column(name: str, options: Mapping[str, Any] | None = None, called: str = "") -> Column:
    """The column of a metric; for a metric that is not installed, a column with only the name.

    Args:
        options: the options as a study states them; None if all have their defaults.
        called: the name of the column, if it differs from that of the metric.
    """
    column = Column(called or name, float, role="error", title=called or with_options(name, options or {}))
    registered = name.partition(" (")[0]  # a column may have options in brackets
    if registered not in METRICS.names():
        return column
    metric = METRICS.get(registered)
    unit = metric.unit_with(options or {}).removeprefix("1")
    return replace(column, unit=unit, lower_is_better=metric.lower_is_better, signed=metric.signed)


def list_metric_columns(metrics: Iterable[Any]) -> list[Column]:
    """The columns of the metrics of a resolved study; it states each as a name or {name: options}."""
    return [
        make_metric_column(name, options, called if called != name else "")
        for called, (name, options) in read_metric_options(metrics).items()
    ]


def read_metric_options(metrics: Iterable[Any]) -> dict[str, tuple[str, Mapping[str, Any]]]:
    """For each column of a metric that a resolved study states, the name and the options of the metric."""
    stated = [(each, {}) if isinstance(each, str) else next(iter(each.items())) for each in metrics]
    return dict(zip(name_columns(stated), stated, strict=True))


def collect_columns(metrics: Iterable[Any]) -> dict[str, Column]:
    """The columns of results with the metrics of a resolved study; the RMS error is always measured."""
    own = [*list_metric_columns(metrics), make_metric_column("rms")]
    return dict(COLUMNS) | {column.name: column for column in own}


def columns_to_json(columns: Mapping[str, Column]) -> list[dict[str, Any]]:
    """The contents of `columns.json`."""
    return [column.as_dict() for column in columns.values()]


def columns_from_json(stated: Any) -> dict[str, Column]:
    """The columns in the contents of `columns.json`; InputError if these are something else."""
    try:
        return {column.name: column for column in map(Column.from_dict, stated)}
    except (TypeError, KeyError, AttributeError):
        raise InputError("columns.json does not hold a table of columns") from None
