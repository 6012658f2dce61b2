"""The parts of a cell: its own material, view and method with their keys, and the source of all its classes."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from glossbench.brdf.material import Material
from glossbench.errors import MethodError
from glossbench.metrics import METRICS, Metric
from glossbench.options import copy_of
from glossbench.process.state import is_foreign
from glossbench.provenance import compute_source_hash
from glossbench.run.study_lights import ChangedInput
from glossbench.scene.points import View
from glossbench.shading.method import Method
from glossbench.shading.outputs import check_key
from glossbench.study.cells import Cell


@dataclass(frozen=True)
class CellParts:
    """The material, view and method of a cell, and their keys as text.

    They are copies, because a plug-in may write into them. What they read from files is released with the cell.
    """

    material: Material
    view: View
    method: Method
    keys: tuple[str, ...]

    @classmethod
    def from_cell(cls, cell: Cell) -> "CellParts":
        """The parts of a cell; raises whatever a plug-in raises."""
        material, view, method = copy_of(cell.material), copy_of(cell.view), copy_of(cell.method)
        return cls(material, view, method, tuple(check_key(each.name, each.key()) for each in (material, view, method)))

    def check_unchanged(self, cell: Cell) -> None:
        """Check that the files which they read are still those that the keys name.

        Raises:
            ChangedInput: a file has changed.
            MethodError: the key of a plug-in differs at each call, or a plug-in wrote into one of our items.
        """
        for i, each in enumerate((self.material, self.view, self.method)):
            if each.key() == self.keys[i]:
                continue
            if is_foreign(type(each)):
                raise MethodError(f"{each.name}.key returns a different text each time, or its file has changed")
            if CellParts.from_cell(cell).keys[i] == self.keys[i]:
                raise MethodError(f"{self.method.name} writes into {each.name}, which other cells read")
            raise ChangedInput(f"a file of {each.name} has changed while the study ran; run it again")


class Sources:
    """Hashes of the source of everything that takes part in cells; each is computed once per run.

    Args:
        metrics: all metrics that are measured, by column.
    """

    def __init__(self, metrics: Mapping[str, Metric]) -> None:
        self._metrics = {column: (type(metric), metric.as_dict()) for column, metric in metrics.items()}
        self._known: dict[type, str] = {}

    def list_by_kind(self, cell: Cell) -> dict[str, Any]:
        """By kind, the hash of each class of a cell; for metrics a list of (column, options, hash)."""
        light, material, view, method = map(self._hash, _list_classes(cell))
        metrics = [[column, options, self._hash(cls)] for column, (cls, options) in self._collect_metrics(cell).items()]
        return {"light": light, "material": material, "view": view, "method": method, "metrics": metrics}

    def has_foreign(self, cell: Cell) -> bool:
        """Whether a plug-in takes part in a cell."""
        return any(map(is_foreign, [*_list_classes(cell), *(cls for cls, _ in self._collect_metrics(cell).values())]))

    def has_foreign_inputs(self, cell: Cell) -> bool:
        """Whether the light, material or view comes from a plug-in."""
        return any(map(is_foreign, _list_classes(cell)[:3]))

    def _collect_metrics(self, cell: Cell) -> dict[str, tuple[type, dict[str, Any]]]:
        """All metrics that are measured, and the metric by which the cell is tuned."""
        tune = cell.tune
        if tune is None or tune.metric in self._metrics:
            return self._metrics
        return {**self._metrics, tune.metric: (METRICS.get(tune.metric), {})}

    def _hash(self, cls: type) -> str:
        if cls not in self._known:
            self._known[cls] = compute_source_hash(cls)
        return self._known[cls]


def _list_classes(cell: Cell) -> tuple[type, ...]:
    return type(cell.light), type(cell.material), type(cell.view), type(cell.method)
