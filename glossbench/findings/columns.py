"""The table of columns of a study's results: those of every cell, and one for each of its metrics."""

from collections.abc import Iterable, Mapping
from typing import Any

from glossbench.columns import COLUMNS, Column
from glossbench.errors import InputError
from glossbench.metrics import METRICS, Metric

__all__ = ["COLUMNS", "Column", "column_of_metric", "columns_from_json", "columns_of", "columns_to_json"]


def column_of_metric(metric: str | type[Metric]) -> Column:
    """The column of a metric; of a name that is not installed, one that says no more than the name."""
    if isinstance(metric, str):
        if metric not in METRICS.names():
            return Column(metric, float, role="error", title=metric)
        metric = METRICS.get(metric)
    unit = "" if metric.unit == "1" else metric.unit
    return Column(
        metric.name, float, unit, role="error", title=metric.name, lower_is_better=metric.lower_is_better,
        signed=metric.signed,
    )  # fmt: skip


def columns_of(metrics: Iterable[str | type[Metric]]) -> dict[str, Column]:
    """The columns of results with these metrics, by name; the RMS error is always measured."""
    own = [column_of_metric(metric) for metric in [*metrics, "rms"]]
    return dict(COLUMNS) | {column.name: column for column in own}


def columns_to_json(columns: Mapping[str, Column]) -> list[dict[str, Any]]:
    """What `columns.json` holds."""
    return [column.as_dict() for column in columns.values()]


def columns_from_json(stated: Any) -> dict[str, Column]:
    """The columns that `columns.json` holds; InputError where it holds something else."""
    try:
        return {column.name: column for column in map(Column.of_dict, stated)}
    except (TypeError, KeyError, AttributeError):
        raise InputError("columns.json does not hold a table of columns") from None
