"""Made results: discs whose errors are known, in folders as runs leave them; and what their pages hold."""

import json
import re
import zlib
from base64 import b64decode

import numpy as np
import OpenEXR
import pandas as pd
import yaml
from PIL import Image

SCRIPT = "<script>alert('x')</script>"
N = 64
NOISE = 2e-3
METHODS = {"regular_sampling": 1.0, "filtered_importance_sampling": 2.0, "split_sum": 8.0}
CLAIMS = [
    ("Regular sampling has the lower error", "holds"),
    ("Split sum is cheapest", "does not hold"),
    ("All agree at 1024 samples", "within noise"),
    ("The same on a GPU", "not tested"),
]


def write_results(folder, budgets=(4, 16, 64, 256)):
    """A folder of results as a run leaves it."""
    rng = np.random.default_rng(7)
    for name in ("images", "references"):
        (folder / name).mkdir(parents=True)
    y, x = (np.mgrid[:N, :N] + 0.5) / N * 2 - 1
    mask = x**2 + y**2 < 0.9
    rows = []
    for i, m in enumerate(([0.1, 0.1], [0.2, 0.075])):
        reference_key = f"ref{i}"
        highlight = np.exp(-((x + 0.3) ** 2 + (y + 0.3) ** 2) / m[0])
        reference = (0.1 + highlight)[..., None] * [1.0, 0.9, 0.7] * mask[..., None]
        write_exr(folder / "references" / f"{reference_key}.exr", reference)
        write_exr(
            folder / "references" / f"{reference_key}_standard_error.exr",
            NOISE * mask[..., None] * np.ones(3),
        )
        Image.fromarray(np.uint8(255 * mask)).save(folder / "references" / f"{reference_key}_mask.png")
        shared = {"reference_key": reference_key, "light": "spots", "light_options": '{"seed": 7}',
                  "material": "kurt", "material_options": json.dumps({"m": m, "f0": 1.0}), "view": "sphere",
                  "view_options": json.dumps({"resolution": N}), "reference_noise": NOISE,
                  "reference_mean": float(reference[mask].mean()), "reference_samples": 65536,
                  "reference_seconds": 12.5, "version": "0.1.0", "torch": "2.8.0", "device": "cpu", "seed": 3,
                  "light_key": "f00d" * 4}  # fmt: skip
        for method, size in METHODS.items():
            for n in budgets if method != "split_sum" else budgets[:1]:
                n_samples = n if method != "split_sum" else 1
                rms = 0.1 * size / np.sqrt(n)
                error = rms * (rng.standard_normal((N, N, 3)) * 0.6 + 0.8 * np.sign(x)[..., None]) * mask[..., None]
                key = f"{method}-{n}-{i}"
                write_exr(folder / "images" / f"{key}.exr", reference + error)
                if method == "regular_sampling" and n <= 64:
                    u = (np.arange(n) + 0.5) / n
                    half_vectors = np.stack([np.arctan(m[0] * np.sqrt(-np.log(1 - u))), 2.4 * np.arange(n)], 1)
                    np.save(folder / "images" / f"{key}_half_vectors.npy", half_vectors)
                options = {"samples": n, "mip_bias": 0.35} if method != "split_sum" else {"levels": 6}
                rows.append(shared | {
                    "key": key, "method": method, "options": json.dumps(options),
                    "tuned": '{"mip_bias": 0.35}' if method == "regular_sampling" else "{}",
                    "status": "done", "reason": None, "rms": float(np.sqrt(np.mean(error[mask] ** 2))),
                    "relative_rms": rms / shared["reference_mean"], "mean_error": float(error[mask].mean()),
                    "max_error": float(np.abs(error).max()), "at_noise_floor": False, "n_samples": n_samples,
                    "stage_seconds": json.dumps({"pyramid": 0.0123, "visibility": 0.002}),
                    "update_seconds": json.dumps({"light": 0.0143, "geometry": 0.002, "view": 0.002}),
                    "shade_seconds": 1e-4 * n, "state_bytes": 2_100_000,
                })  # fmt: skip
        rows[-2] |= {"at_noise_floor": True, "rms": 1.7 * NOISE}
        none = dict.fromkeys(
            ("rms", "relative_rms", "mean_error", "max_error", "shade_seconds", "state_bytes", "n_samples")
        )
        for method, status, reason in (
            ("lighting_factorization", "skipped", "the BRDF must be isotropic, m is (0.2, 0.075)"),
            ("broken", "failed", f"Traceback (most recent call last):\n  line 3\nMethodError: {SCRIPT}"),
        ):
            rows.append(shared | none | {
                "key": f"{method}-{i}", "method": method, "options": '{"samples": 64}', "tuned": "{}",
                "status": status, "reason": reason, "at_noise_floor": False, "stage_seconds": "{}",
                "update_seconds": "{}",
            })  # fmt: skip
    study = {
        "title": f"Highlights stay well defined at 14 and 17 samples {SCRIPT}",
        "source": "Luksch et al. 2014, Figure 8",
        "question": "Which sampling keeps the highlight at a small budget?",
        "light": [{"spots": {"seed": 7}}],
        "material": [{"kurt": {"m": [0.1, 0.1]}}, {"kurt": {"m": [0.2, 0.075]}}],
        "view": [{"sphere": {"resolution": N}}],
        "methods": [{"regular_sampling": {"samples": list(budgets)}}],
        "reference": {"relative_error": 1e-3},
        "metrics": ["rms", "relative_rms", "mean_error", "max_error"],
        "claims": [{"text": text} for text, _ in CLAIMS],
    }
    number = {"where": "kurt, samples = 14", "a": 0.0251, "b": 0.0502, "bound": None, "noise": NOISE}
    claims = [
        {"text": text, "kind": "lower", "verdict": verdict, "summary": f"In 4 of 4 places, {verdict}.",
         "numbers": [number | {"verdict": verdict}] * 4}
        for text, verdict in CLAIMS
    ]  # fmt: skip
    provenance = {"glossbench": "0.1.0", "python": "3.12.1", "torch": "2.8.0", "cores": 2,
                  "started": "2025-01-01T10:00:00", "command": "glossbench run discs"}  # fmt: skip
    (folder / "study.yaml").write_text(yaml.safe_dump(study))
    (folder / "claims.json").write_text(json.dumps(claims))
    (folder / "provenance.json").write_text(json.dumps(provenance))
    pd.DataFrame(rows).to_parquet(folder / "cells.parquet")
    return folder


def write_exr(path, image):
    planes = {c: np.ascontiguousarray(image[..., i], dtype=np.float32) for i, c in enumerate("RGB")}
    OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, planes).write(str(path))


def read_exr(path):
    return np.asarray(OpenEXR.File(str(path)).channels()["RGB"].pixels, dtype=np.float64)


def data_of(page):
    """What the script of the plots reads."""
    deflated = re.search(r'<script type="application/octet-stream;base64" id="plot-data">(.*?)</script>', page)[1]
    return json.loads(zlib.decompress(b64decode(deflated)))


def three_lights(folder):
    """The results of two materials as if they were two lights, and a third with the images of the first."""
    write_results(folder, budgets=(4, 64))
    cells = pd.read_parquet(folder / "cells.parquet")
    cells["light_options"] = [json.dumps({"seed": key[-1]}) for key in cells.reference_key]
    cells["material_options"] = "{}"
    third = cells[cells.reference_key == "ref0"].assign(reference_key="ref2", light_options='{"seed": 9}')
    third = third.assign(key=third.key + "-third", rms=2 * third.rms)
    for kind, old, new in [
        ("references", "ref0", "ref2"),
        *(("images", k.removesuffix("-third"), k) for k in third.key),
    ]:
        for path in (folder / kind).glob(f"{old}*"):
            (path.parent / path.name.replace(old, new)).write_bytes(path.read_bytes())
    pd.concat([cells, third]).to_parquet(folder / "cells.parquet")
    return folder


def three_materials(folder, values):
    cells = pd.read_parquet(three_lights(folder) / "cells.parquet")
    numbers = dict(zip(("ref0", "ref1", "ref2"), values, strict=True))
    cells["material_options"] = [json.dumps({"s": numbers[key]}) for key in cells.reference_key]
    cells["light_options"] = "{}"
    cells["options"] = [
        json.dumps({"samples": 64, "filter": "gauss"} if "-64-" in key else {"samples": 4, "filter": "box"})
        for key in cells.key
    ]
    cells["tuned"] = "{}"
    cells.to_parquet(folder / "cells.parquet")
    return folder


def metrics_of(data):
    """Metrics that the page's plots may be under, in order."""
    named = [data["pool"][case["given"]["metric"]] for figure in data["figures"] for case in figure["cases"]]
    return list(dict.fromkeys(each["name"] for each in named if each["part"] == "Metrics"))


def labels_of(data):
    """Names and looks of all lines of the page's plots."""
    panels = [panel for figure in data["figures"] for case in figure["cases"] for panel in case["panels"]]
    return [data["pool"][data["pool"][rest]["label"]] for panel in panels for _, _, rest in panel["lines"]]
