"""Single figures of results, each a file of its own: .pdf, .svg or .png.

What a figure may be told by name (group, metric, over, crop) is what its function takes; the command line asks no more.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, cast

from glossbench.atomic import replacing
from glossbench.errors import InputError, nearest
from glossbench.metrics import METRICS
from glossbench.run.results import Results
from glossbench.study.labels import parsed

from ..model.answer import answer_of, claimed
from ..model.axes import Place, Sweep, places_of, sweeps_of, with_costs
from ..model.axes import named as named_sweeps
from ..model.conditions import Group, grouped, methods_of
from ..model.crops import Crop
from ..model.lines import COSTS, axis_of, lines_at
from ..model.selection import MOST_PICTURES, chosen, middle_budgets
from ..style import looks
from ..typesetting import Format, Press
from .images import PrintedGroup
from .plots import Panel, against_costs, cost_over_sweep, error_by_method, facets, over_sweep, plot
from .profile import brightest_row, cross_section


def answer(folder: Path, path: Path, *, metric: str | None = None) -> None:
    """The picture of the report's first page: crops of the methods where the metric tells most between them."""
    run = _read(folder, metric)
    found = answer_of(run.groups, run.metric, claimed(run.results))
    if found is None:
        raise InputError(f"{folder} has no cell with an image and {run.metric}")
    with Press() as press:
        data = PrintedGroup(run.results, found.group, press).crops(found.cells)
        _write(press, path, {"kind": "crops", **data})


def crops(
    folder: Path,
    path: Path,
    *,
    group: int | None = None,
    metric: str | None = None,
    crop: Sequence[tuple[int, int, int, int]] = (),
) -> None:
    """Crops of each method at its middle budget, with their errors, beside a marked reference."""
    run = _read(folder, metric)
    of = _numbered(run, run.groups, group)
    with Press() as press:
        printed = PrintedGroup(run.results, of, press, metric)
        data = printed.crops(middle_budgets(of), [_inside(Crop(*each), printed) for each in crop])
        _write(press, path, {"kind": "crops", **data})


def images(folder: Path, path: Path, *, group: int | None = None, metric: str | None = None) -> None:
    """Whole images over their signed errors, or over the error maps of a metric."""
    run = _read(folder, metric)
    of = _numbered(run, run.groups, group)
    with Press() as press:
        printed = PrintedGroup(run.results, of, press, metric)
        _write(press, path, {"kind": "images", **printed.whole(chosen([of], MOST_PICTURES)[0])})


def profile(folder: Path, path: Path, *, group: int | None = None) -> None:
    """Radiance along the row of the reference's brightest pixel, of the reference and of each method."""
    run = _read(folder, None)
    of = _numbered(run, run.groups, group)
    key = of.reference["reference_key"]
    reference, mask = run.results.reference(key), run.results.mask(key)
    cells = middle_budgets(of)
    drawn = looks([str(cell.row["method"]) for cell in cells], methods_of(run.groups))
    images = [(cell.name, run.results.image(cell.row["key"]), look) for cell, look in zip(cells, drawn, strict=True)]
    row = brightest_row(reference, mask)
    with Press() as press:
        figure = cross_section(reference, images, mask, row)
        alt = f"radiance along row {row} of each method: {of.title}"
        _write(press, path, {"kind": "plot", "alt": alt, **press.figure(figure)})


def convergence(
    folder: Path, path: Path, *, group: int | None = None, metric: str | None = None, over: str | None = None
) -> None:
    """A metric or cost over what the study sweeps, with fitted slopes and the reference's noise; else by method."""
    run = _read(folder, None if metric in COSTS else metric)
    place = _numbered(run, _single(run, _swept(run, over)), group)
    cost = metric if metric in COSTS else None
    panels = cost_over_sweep(place, run.metric, cost) if cost else over_sweep(place, run.metric)
    _plot(run, place, facets(panels), path)


def costs(folder: Path, path: Path, *, group: int | None = None, metric: str | None = None) -> None:
    """A metric over shading time, update costs and memory, with the Pareto front."""
    run = _read(folder, metric)
    place = _numbered(run, _single(run, with_costs(run.sweeps)[0]), group)
    _plot(run, place, against_costs(place, run.metric), path)


Titled = TypeVar("Titled", Group, Place)


class _Run(NamedTuple):
    results: Results
    groups: Sequence[Group]
    metric: str
    sweeps: Mapping[str, Sweep]


def _read(folder: Path, metric: str | None) -> _Run:
    """Results with the groups that have images, and the metric that was asked for or the study's first."""
    results = Results.open(folder)
    cells = results.cells
    metrics = [name for name in results.study.get("metrics") or () if name in cells.columns]
    known = {*metrics, *(name for name in METRICS.names() if name in cells.columns)}
    if metric is not None and metric not in known:
        raise InputError(f"{folder} has no metric {metric!r}{nearest(metric, known)}")
    groups = grouped([parsed(row) for row in cells.to_dict("records")], sorted(known))
    done = [group for group in groups if group.done]
    sweeps = sweeps_of(done, results.study.get("claims") or ())
    return _Run(results, done, metric or (metrics or ["rms"])[0], sweeps)


def _swept(run: _Run, name: str | None) -> Sweep:
    """A sweep by its name, full or short; without one the first."""
    if name is None:
        return next(iter(run.sweeps.values()))
    found = named_sweeps(run.sweeps.values(), name)
    if len(found) > 1:
        meant = " or ".join(sweep.full_name for sweep in found)
        raise InputError(f"--over {name} may mean {meant}: say which")
    if not found:
        known = ", ".join(run.sweeps)
        raise InputError(f"{run.results.folder} sweeps no {name!r}: --over must be one of {known}")
    return found[0]


def _single(run: _Run, sweep: Sweep) -> list[Place]:
    """The places that are no mean over lights."""
    return [place for place in places_of(run.groups, sweep) if len(place.lights) == 1]


def _numbered(run: _Run, members: Sequence[Titled], number: int | None) -> Titled:
    """A group or place by its number from 1 on; without one the only one that there is."""
    titles = "; ".join(f"{i}: {each.title}" for i, each in enumerate(members, 1))
    if not members:
        raise InputError(f"{run.results.folder} has no cell with an image")
    if number is None and len(members) > 1:
        raise InputError(f"which light, material and view? --group must be one of {titles}")
    if number is not None and not 1 <= number <= len(members):
        raise InputError(f"--group must be one of {titles}, got {number}")
    return members[(number or 1) - 1]


def _inside(crop: Crop, printed: PrintedGroup) -> Crop:
    height, width = printed.mask.shape
    if (
        min(crop) < 0
        or min(crop.width, crop.height) < 1
        or crop.x + crop.width > width
        or crop.y + crop.height > height
    ):
        asked = ",".join(map(str, crop))
        raise InputError(f"--crop X,Y,WIDTH,HEIGHT must lie within {width} x {height} pixels, got {asked}")
    return crop


def _plot(run: _Run, place: Place, panels: Sequence[Panel], path: Path) -> None:
    lines = lines_at(place, run.metric)
    if not lines:
        raise InputError(f"no cell of {place.title} has {run.metric}")
    with Press() as press:
        figure = plot(panels) if panels else error_by_method(lines, axis_of(place, run.metric))
        alt = f"{run.metric} of each method: {place.title}"
        _write(press, path, {"kind": "plot", "alt": alt, **press.figure(figure)})


def _write(press: Press, path: Path, data: dict[str, Any]) -> None:
    """The figure in the form that the name of its file asks for, whole or not at all."""
    form = path.suffix.lower().lstrip(".")
    if form not in ("pdf", "svg", "png"):
        raise InputError(f"{path}: the extension must be .pdf, .svg or .png, got {path.suffix!r}")
    content = press.pages("figure.typ", data, cast("Format", form))
    with replacing(path) as part:
        part.write_bytes(content)
