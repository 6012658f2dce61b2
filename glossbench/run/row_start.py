"""The row of a cell before anything is measured, and of one that failed."""

import json
from collections.abc import Sequence
from typing import Any

import torch

from glossbench.provenance import glossbench_version, processor
from glossbench.shading.costs import Costs
from glossbench.shading.outputs import printable
from glossbench.study.cells import Cell


def begin_row(
    cell: Cell, key: str, reference_key: str, light_key: str, metrics: Sequence[str], device: str, seed: int, code: str
) -> dict[str, Any]:
    """The columns that every cell has, with nothing measured yet."""
    nothing = float("nan")
    costs, tune = Costs(), cell.method.tune
    return {
        "key": key, "reference_key": reference_key,
        "light": cell.light.name, "material": cell.material.name,
        "view": cell.view.name, "method": cell.method.name,
        "light_options": cell.light.json, "material_options": cell.material.json,
        "view_options": cell.view.json, "options": json.dumps(cell.method.options, sort_keys=True),
        "tuned": "{}", "tune": json.dumps({tune.option: cell.method.spelled()[tune.option]} if tune else {}),
        "status": "done", "reason": "", "notes": "[]",
        **dict.fromkeys([*metrics, "rms"], nothing),
        "reference_noise": nothing, "reference_peak_noise": nothing, "reference_target": nothing,
        "reference_mean": nothing, "reference_samples": 0,
        "left_out": "{}", "at_noise_floor": False,
        "is_random": False, "n_samples": 0, "budget": "", "stage_seconds": json.dumps(costs.stage_seconds),
        "update_seconds": json.dumps(costs.update_seconds), "state_bytes": 0,
        "shade_seconds": nothing, "shade_seconds_low": nothing, "shade_seconds_high": nothing, "shade_runs": 0,
        "busy": nothing, "reference_seconds": nothing,
        "version": glossbench_version(), "torch": torch.__version__, "device": device,
        "processor": processor(), "seed": seed, "light_key": light_key,
        "code": code[:20],
    }  # fmt: skip


def failure(reason: str) -> dict[str, Any]:
    """Columns of a cell that failed; half a character, which a name of a file may hold, is escaped."""
    return {"status": "failed", "reason": printable(reason)}
