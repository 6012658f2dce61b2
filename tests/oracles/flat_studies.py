"""Small studies of methods that show one radiance everywhere, and what their runs leave."""

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, ClassVar

import pytest
import torch
from pydantic import Field

from glossbench.metrics import METRICS, Metric
from glossbench.run.results import Results
from glossbench.shading.method import METHODS, Method, stage
from glossbench.study.study import Study, load_study

TIMES = [
    "stage_seconds", "update_seconds", "shade_seconds", "shade_seconds_low", "shade_seconds_high", "shade_runs", "busy",
    "reference_seconds",
]  # fmt: skip


CALLS: Counter[str] = Counter()


@stage
def mean_light(self, light):
    """A stage that two methods share."""
    CALLS["mean_light"] += 1
    return light.faces.mean((0, 1, 2))


class Flat(Method):
    """Shows one radiance everywhere."""

    name = "flat"
    samples: int = 1
    level: Annotated[float, Field(ge=0, le=1)] = 0.5
    seed: int = 0
    fails: ClassVar[bool] = False

    mean_light = mean_light

    def supports(self, material, scene):
        return "too many samples" if self.samples > 100 else None

    def shade(self, points, material, mean_light):
        CALLS[f"flat {self.samples}"] += 1
        if self.fails and self.samples == 2:
            raise RuntimeError("planted [/fault]")
        return torch.full((len(points), 3), self.level)


class Other(Method):
    """The same options as another method of the same file, and another image."""

    name = "other"
    samples: int = 1
    level: Annotated[float, Field(ge=0, le=1)] = 0.5
    seed: int = 0

    mean_light = mean_light

    def shade(self, points, material, mean_light):
        return mean_light.expand(len(points), 3).contiguous()


class Reckless(Flat):
    """The planted fault of a stage of one's own in place of a shared one."""

    name = "reckless"

    @stage
    def mean_light(self, light):
        CALLS["mean_light"] += 1
        return light.faces.mean((0, 1, 2)) + 0 * self.samples


class Distance(Metric):
    """The signed difference of the image from 0.37, independent of the truth."""

    name = "distance"
    formula = "mean(x) - 0.37"
    unit = "1"

    def errors(self, x, y, mask):
        """The map."""
        return x.mean(axis=2) - 0.37


@contextmanager
def registered() -> Iterator[pytest.MonkeyPatch]:
    """A block in which the methods and the metric of this file can be named, and what else may be replaced in it."""
    with METHODS.isolated(), METRICS.isolated(), pytest.MonkeyPatch.context() as patch:
        for cls in (Flat, Other, Reckless):
            METHODS.register(cls.name)(cls)
        METRICS.register("distance")(Distance)
        patch.setattr(Flat, "fails", False)
        yield patch


def study_in(folder: Path, **changes: Any) -> Study:
    """A small study; keys that are given replace its own."""
    keys = {
        "title": "T",
        "light": "{gradient: {resolution: 16}}",
        "material": "{ggx: {alpha: 0.5}}",
        "view": "{sphere: {resolution: 8}}",
        "methods": "{flat: {samples: [1, 2, 3]}}",
        "reference": "{relative_error: 0.05}",
        "metrics": "[rms, mean_error]",
    } | changes
    (folder / "s.yaml").write_text("".join(f"{key}: {value}\n" for key, value in keys.items()))
    return load_study(folder / "s.yaml")


def remains(folder: Path) -> dict[str, bytes]:
    """All that a run left but times: the table without their columns, the study, the verdicts, the images."""
    table = Results(folder).cells.drop(columns=TIMES).to_parquet()
    names = [path for path in folder.rglob("*") if path.suffix in (".exr", ".png", ".yaml", ".npy", ".npz")]
    files = {str(path.relative_to(folder)): path.read_bytes() for path in [*names, folder / "claims.json"]}
    return {"table": table, **files}


def interrupting(call, at: int):
    """A function that is interrupted when it is called for the at-th time, from 0."""
    count = iter(range(10**6))

    def interrupted(*args: Any, **kwargs: Any) -> Any:
        if next(count) == at:
            raise KeyboardInterrupt
        return call(*args, **kwargs)

    return interrupted
