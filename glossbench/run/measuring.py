"""Measure one cell: its tuned option, its image, the metrics and the costs."""

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glossbench.brdf.material import Material
from glossbench.columns import CellRecord
from glossbench.envmap.cubemap import CubeMap
from glossbench.metrics import METRICS, Metric
from glossbench.options import copy_of
from glossbench.process.state import guarded, is_foreign
from glossbench.run.tuning import tune_option
from glossbench.scene.points import View
from glossbench.shading.image import Image, shade
from glossbench.shading.method import Method
from glossbench.shading.outputs import check_number, check_pattern
from glossbench.shading.stage_cache import StageCache
from glossbench.study.cells import Tuning
from glossbench.truth.jackknife import remove_bias
from glossbench.truth.reference import Reference


class Measurement(NamedTuple):
    """The record of a cell, its image, the pattern (N, 2) of a method that has one, and the time of the metrics [s]."""

    record: CellRecord
    image: Image
    half_vectors: NDArray[np.float32] | None
    metric_seconds: float


def measure(
    record: CellRecord, method: Method, tune: Tuning | None, metrics: Mapping[str, Metric], cache: StageCache,
    light: CubeMap, material: Material, view: View, truth: Reference,
) -> Measurement:  # fmt: skip
    """Shade a material under a light with a method, and compare the image with the reference.

    Args:
        record: the record of the cell, with nothing measured yet.
        tune: an option to be set first to the value at which a metric is lowest.
        metrics: the metrics by column; rms is among them.
        cache: stages that cells share.
        truth: the reference.

    Raises:
        MethodError: as in `shade`; or a metric does not return a number, or the method wrote into a stage that other
            cells read.
    """
    tuned: dict[str, float] = {}

    def compute_metric(metric: Metric, image: Image, *references: Reference) -> list[float]:
        """The metric against each of some references."""
        seen = replace(image, radiance=view.recorded(image.radiance))
        recorded = [replace(each, radiance=view.recorded(each.radiance)) for each in references]
        with guarded(type(metric)):
            # A plug-in may write into itself.
            owns = (copy_of(metric) if is_foreign(type(metric)) else metric for _ in recorded)
            values = [own(seen, each) for own, each in zip(owns, recorded, strict=True)]
        return [check_number(metric.name, value) for value in values]

    def with_left_out(metric: Metric, image: Image) -> list[float]:
        """The metric against the whole reference, then without each group; only the first if any is not finite."""
        values = compute_metric(metric, image, truth, *truth.left_out(metric.n_groups))
        return values if np.isfinite(values).all() else values[:1]

    def shade_candidate(candidate: Method, time_it: bool) -> Image:
        with guarded(type(candidate)):
            return shade(candidate, light, material, view, cache=cache, time_it=time_it)

    if tune is not None:
        least = metrics[tune.metric] if tune.metric in metrics else METRICS.create(tune.metric, {})

        def measure_error(value: float) -> float:
            candidate = replace(method, **{tune.option: value})
            [error] = compute_metric(least, shade_candidate(candidate, time_it=False), truth)
            return error

        tuned = {tune.option: tune_option(tune, measure_error)}
        method = replace(method, **tuned)
    image = shade_candidate(method, time_it=True)
    with guarded(type(method)):
        half_vectors = check_pattern(method.name, method.half_vectors(material))
    cache.check(method.name)
    began = time.perf_counter()
    compared = {column: with_left_out(metric, image) for column, metric in metrics.items()}
    metric_seconds = time.perf_counter() - began
    costs = image.costs
    record = replace(
        record, tuned=tuned, options=method.as_dict(),
        metrics={name: remove_bias(values) for name, values in compared.items()},
        left_out={name: values for name, values in compared.items() if len(values) > 1},
        kernels=dict(sorted(image.kernels.items())),
        at_noise_floor=compared["rms"][0] < 2 * truth.noise, is_random=bool(method.is_random),
        n_samples=costs.n_samples, state_bytes=costs.state_bytes,
        stage_seconds=dict(costs.stage_seconds), update_seconds=dict(costs.update_seconds),
        shade_seconds=costs.shade.median, shade_seconds_low=costs.shade.low, shade_seconds_high=costs.shade.high,
        shade_runs=costs.shade.runs, busy=costs.shade.busy,
    )  # fmt: skip
    return Measurement(record, image, half_vectors, metric_seconds)
