"""Rows of results with chosen errors, noise and costs."""

import json

from glossbench.columns import parse_row


def trial_row(
    method, light="a", material="m", error=1.0, left_out=(), ms=1.0, update=None, mb=1.0, samples=None,
    seed=None, **others,
):  # fmt: skip
    """One cell; `ms` is its shading time, and `update` has the times by change [ms]."""
    options = {"samples": samples} if samples is not None else {}
    return parse_row({
        "key": f"{method}-{samples}-{seed}-{light}-{material}", "reference_key": f"{light}-{material}", "light": light,
        "light_options": "{}", "material": material, "material_options": "{}", "view": "sphere", "view_options": "{}",
        "method": method, "options": json.dumps(options | ({} if seed is None else {"seed": seed})), "tuned": "{}",
        "budget": "samples" if samples is not None else "", "status": "done", "reason": "", "rms": error,
        "left_out": json.dumps({"rms": [error, *left_out]} if left_out else {}), "is_random": seed is not None,
        "at_noise_floor": False, "n_samples": samples or 1, "shade_seconds": 1e-3 * ms, "shade_runs": 5,
        "stage_seconds": json.dumps({"all": 1e-3 * sum((update or {}).values())}),
        "update_seconds": json.dumps({change: 1e-3 * own for change, own in (update or {}).items()}),
        "state_bytes": 1e6 * mb,
    } | others)  # fmt: skip
