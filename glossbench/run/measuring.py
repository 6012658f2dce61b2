"""Measuring one cell: its tuned option, its image, the metrics and the costs."""

import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glossbench.brdf.material import Material
from glossbench.envmap.cubemap import CubeMap
from glossbench.metrics import METRICS
from glossbench.process.state import guarded
from glossbench.run.tuning import tune_option
from glossbench.scene.points import View
from glossbench.shading.method import Image, Method, budget_of, shade
from glossbench.shading.outputs import number_of, pattern_of
from glossbench.shading.stage_cache import StageCache
from glossbench.study.cells import Tune
from glossbench.truth.jackknife import unbiased
from glossbench.truth.reference import Reference


class Measured(NamedTuple):
    """Columns of a cell's row, its image, and the pattern (N, 2) of a method that has one."""

    columns: dict[str, Any]
    image: Image
    half_vectors: NDArray[np.float32] | None


def measure(
    method: Method, tune: Tune | None, metrics: Sequence[str], cache: StageCache,
    light: CubeMap, material: Material, view: View, truth: Reference,
) -> Measured:  # fmt: skip
    """What a method shows of a material under a light, against the truth.

    Args:
        tune: the option to be set first where a metric is least.
        metrics: by name; rms is always there.
        cache: stages that other cells left and may use.

    Raises:
        MethodError: as `shade`; or a metric is no number, or the method wrote into a stage that others read.
    """
    tuned: dict[str, float] = {}

    def metric_of(name: str, image: Image, reference: Reference = truth) -> float:
        seen, recorded = (replace(each, radiance=view.recorded(each.radiance)) for each in (image, reference))
        with guarded(METRICS.get(name)):
            value = METRICS.create(name, {})(seen, recorded)
        return number_of(name, value)

    def with_left_out(name: str, image: Image) -> list[float]:
        """A metric against the reference, and against it without each group; alone if any of these is infinite."""
        values = [metric_of(name, image, each) for each in (truth, *truth.left_out(METRICS.get(name).n_groups))]
        return values if np.isfinite(values).all() else values[:1]

    def shaded(candidate: Method, time_it: bool) -> Image:
        with guarded(type(candidate)):
            return shade(candidate, light, material, view, cache=cache, time_it=time_it)

    if tune is not None:
        least = tune.metric

        def error(value: float) -> float:
            candidate = replace(method, **{tune.option: value})
            return metric_of(least, shaded(candidate, time_it=False))

        tuned = {tune.option: tune_option(tune, error)}
        method = replace(method, **tuned)
    image = shaded(method, time_it=True)
    with guarded(type(method)):
        half_vectors = pattern_of(method.name, method.half_vectors(material))
    cache.check(method.name)
    compared = {name: with_left_out(name, image) for name in dict.fromkeys([*metrics, "rms"])}
    columns = {
        "tuned": json.dumps(tuned),
        "options": json.dumps(method.as_dict(), sort_keys=True),
        **{name: unbiased(values) for name, values in compared.items()},
        "left_out": json.dumps({name: values for name, values in compared.items() if len(values) > 1}),
        "at_noise_floor": compared["rms"][0] < 2 * truth.noise,
        "is_random": bool(method.is_random),
        "n_samples": image.costs.n_samples,
        "budget": budget_of(type(method)),
        "stage_seconds": json.dumps(image.costs.stage_seconds),
        "update_seconds": json.dumps(image.costs.update_seconds),
        "shade_seconds": image.costs.shade.median,
        "shade_seconds_low": image.costs.shade.low,
        "shade_seconds_high": image.costs.shade.high,
        "shade_runs": image.costs.shade.runs,
        "busy": image.costs.shade.busy,
        "state_bytes": image.costs.state_bytes,
    }
    return Measured(columns, image, half_vectors)
