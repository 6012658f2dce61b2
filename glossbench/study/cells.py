"""What a study compares: lights, materials, views and methods by name, and the cells that they make."""

import json
from dataclasses import dataclass, field, replace
from typing import Any

from glossbench.shading.method import METHODS


@dataclass(frozen=True)
class Item:
    """A light, material or view by name, with all its options as JSON types."""

    name: str
    options: dict[str, Any] = field(hash=False)

    def spelled(self) -> dict[str, Any]:
        """The options as a study states them."""
        return dict(self.options)

    @property
    def json(self) -> str:
        """The options as canonical JSON: equal for equal items, whatever the order of keys."""
        return json.dumps(self.spelled(), sort_keys=True)


@dataclass(frozen=True)
class Tune:
    """One option of a method, to be set where a metric is lowest within [low, high]."""

    option: str
    metric: str
    low: float
    high: float


@dataclass(frozen=True)
class MethodItem(Item):
    """A method by name; a tuned option has its default in `options`, or the lowest value.

    Attributes:
        follows_seed: its option `seed` is not stated, and so is the study's.
    """

    tune: Tune | None = None
    follows_seed: bool = field(default=False, compare=False)

    def spelled(self) -> dict[str, Any]:
        """The options as a study states them, a tuned one as {tune: metric, range: [low, high]}."""
        if self.tune is None:
            return dict(self.options)
        tuned = {"tune": self.tune.metric, "range": [self.tune.low, self.tune.high]}
        return {**self.options, self.tune.option: tuned}

    def with_seed(self, seed: int) -> "MethodItem":
        """The method under another seed of its study."""
        if not self.follows_seed:
            return self
        return replace(self, options=METHODS.create(self.name, {**self.options, "seed": seed}).as_dict())


@dataclass(frozen=True)
class Cell:
    """One image to be made and measured."""

    light: Item
    material: Item
    view: Item
    method: MethodItem
