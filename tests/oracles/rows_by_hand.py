"""Rows of results as a run leaves them, with errors that are chosen."""

import json

from glossbench.study.labels import parse_row

RMS = {"few": [0.4, 0.1, 0.05], "many": [0.8, 0.3, 0.02]}
SAMPLES = [4, 16, 64]


def rows(factors):
    """Cells of two methods with three budgets under lights that make each error so many times as large."""
    found = []
    for seed, factor in enumerate(factors):
        for method, errors in RMS.items():
            for n, rms in zip(SAMPLES, errors, strict=True):
                found.append(parse_row({
                    "key": f"{method}-{n}-{seed}", "reference_key": f"r{seed}", "light": "spots",
                    "light_options": json.dumps({"seed": seed}), "material": "kurt", "material_options": "{}",
                    "view": "sphere", "view_options": "{}", "method": method, "options": json.dumps({"samples": n}),
                    "tuned": "{}", "status": "done", "reason": "", "rms": rms * factor, "at_noise_floor": False,
                    "reference_noise": 1e-3 * factor, "reference_mean": 1.0, "n_samples": n, "shade_seconds": 1e-3 * n,
                    "stage_seconds": "{}", "update_seconds": json.dumps({"light": 0.05}), "state_bytes": 2_000_000,
                }))  # fmt: skip
    return found
