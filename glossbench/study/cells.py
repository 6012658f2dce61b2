"""What a study compares: lights, materials, views and methods with their options, and the cells that they make."""

import json
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

from glossbench.brdf.material import Material
from glossbench.columns import CellRecord
from glossbench.envmap.lights.light import Light
from glossbench.options import Options
from glossbench.scene.points import View
from glossbench.shading.method import Method, find_budget_option


@dataclass(frozen=True)
class Tuning:
    """One option of a method, to be set to the value in [low, high] at which a metric is lowest."""

    option: str
    metric: str
    low: float
    high: float


@dataclass(frozen=True)
class Candidate:
    """A method of a study, with at most one option to tune. In `method` that option has its default, or its low bound.

    Attributes:
        follows_seed: the study does not state the option `seed` of this method, so that it is the study's seed.
    """

    method: Method
    tune: Tuning | None = None
    follows_seed: bool = field(default=False, compare=False)

    @property
    def name(self) -> str:
        """The name of the method."""
        return self.method.name

    def as_dict(self) -> dict[str, Any]:
        """The options as a study states them; a tuned option is {tune: metric, range: [low, high]}."""
        options = self.method.as_dict()
        if self.tune is None:
            return options
        return {**options, self.tune.option: {"tune": self.tune.metric, "range": [self.tune.low, self.tune.high]}}

    def with_seed(self, seed: int) -> "Candidate":
        """The candidate for another seed of its study."""
        if not self.follows_seed:
            return self
        return replace(self, method=type(self.method).create({**self.method.as_dict(), "seed": seed}))


@dataclass(frozen=True)
class Cell:
    """One image to be made and measured."""

    light: Light
    material: Material
    view: View
    candidate: Candidate

    @property
    def method(self) -> Method:
        """The method, before an option is tuned."""
        return self.candidate.method

    @property
    def tune(self) -> Tuning | None:
        """The option of the method that is tuned before the cell is measured, or None."""
        return self.candidate.tune

    def make_record(self, **known: Any) -> CellRecord:
        """The record of this cell with nothing measured yet.

        Args:
            known: columns that are known already.
        """
        stated = self.candidate.as_dict()
        return CellRecord(
            light=self.light.name, light_options=self.light.as_dict(),
            material=self.material.name, material_options=self.material.as_dict(),
            view=self.view.name, view_options=self.view.as_dict(),
            method=self.method.name, budget=find_budget_option(type(self.method)), options=self.method.as_dict(),
            tune={self.tune.option: stated[self.tune.option]} if self.tune else {},
            **{"key": "", "reference_key": "", **known},
        )  # fmt: skip


def group_views(cells: Iterable[Cell]) -> list[tuple[Candidate, list[View]]]:
    """Each candidate with the views of its cells, one for each light and material that it meets."""
    found: dict[str, tuple[Candidate, list[View]]] = {}
    for cell in cells:
        found.setdefault(to_text(cell.candidate), (cell.candidate, []))[1].append(cell.view)
    return list(found.values())


def to_text(item: Options | Candidate) -> str:
    """An item as text: equal for equal items, whatever the order of keys."""
    return f"{item.name} {json.dumps(item.as_dict(), sort_keys=True)}"
