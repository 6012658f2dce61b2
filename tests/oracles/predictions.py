"""How near the prediction of `glossbench run --dry-run` comes to what a run takes.

Installed studies are cut to a few cells. All are run with small views of two sizes, from which rates are learned; then
each is predicted with views of four times the pixels, and run. From views of one size alone it is not known what grows
with the pixels. All times are of the processor, so that other work on the machine does not count. Kernels run eagerly:
the time to compile them is not predicted. The first study is run once before, as the first run of a process is slow.

PYTHONPATH=tests python tests/oracles/predictions.py FOLDER [STUDY ...]
"""

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from glossbench.commands.printing import say
from glossbench.run import executor, measuring, rates, references, runner
from glossbench.shading import stage_cache
from glossbench.study.study import Study, load_study

STUDIES = (
    "quickstart", "anisotropy_today", "engines", "visible_normals", "suns", "lod_bias_presets", "occlusion_quickstart",
    "filtered_importance_sampling_figure_3", "filtered_importance_sampling_figure_6", "regular_sampling_figure_4_5",
)  # fmt: skip
SMALL, LARGE, LIGHT = (16, 32), 64, 64  # resolutions
N_METHODS, N_MATERIALS = 5, 1
FACTOR = 2.0


def cut(study: Study, resolution: int) -> Study:
    """Some of the methods and materials of a study, under its first light, with its first view."""

    def resized(item: Any, n: int) -> Any:
        stated = {"resolution": n, "width": None}
        return replace(item, **{name: value for name, value in stated.items() if hasattr(item, name)})

    step = -(-len(study.methods) // N_METHODS)
    return replace(
        study, lights=(resized(study.lights[0], LIGHT),), views=(resized(study.views[0], resolution),),
        materials=study.materials[:N_MATERIALS], methods=study.methods[::step], claims=(), exclude=(),
        reference=study.reference.model_copy(update={"relative_error": max(0.02, study.reference.relative_error)}),
    )  # fmt: skip


def measured(study: Study, folder: Path) -> float:
    began = time.process_time()
    runner.run_study(study, folder)
    return time.process_time() - began


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("studies", nargs="*", metavar="STUDY", help="installed studies (default: ten)")
    given = parser.parse_args()
    names = given.studies or STUDIES
    rates.cache_folder = lambda: given.folder / "cache"
    runner.EAGER_RATE = float("inf")
    for module in (executor, measuring, references, stage_cache):
        module.time = SimpleNamespace(perf_counter=time.process_time)
    measured(cut(load_study(names[0]), SMALL[0]), given.folder / "first")
    (given.folder / "cache" / "rates.json").unlink()
    for name in names:
        for n in SMALL:
            seconds = measured(cut(load_study(name), n), given.folder / f"{name}_{n}")
            say(f"{name}: {seconds:.1f} s with {n}^2 pixels")
    n_near = 0
    for name in names:
        study = cut(load_study(name), LARGE)
        cost = rates.predict(study.cells(), study.reference, study.measured)
        seconds = measured(study, given.folder / f"{name}_large")
        ratio = cost.seconds / seconds
        n_near += 1 / FACTOR < ratio < FACTOR
        say(
            f"{name}: {len(study.cells())} cells, predicted {cost.seconds:.1f} s, measured {seconds:.1f} s, "
            f"ratio {ratio:.2f}, {cost.n_unknown} unknown"
        )
    say(f"{n_near} of {len(names)} predictions are within a factor of {FACTOR:g}")
    sys.exit(n_near < len(names))


if __name__ == "__main__":
    main()
