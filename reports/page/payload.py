"""The images of a report as data for the viewer of the page: radiance in half floats, FLIP maps and masks, deflated.

An image is four planes (R, G, B, A) of half floats: radiance, and in A the FLIP map of a cell or the mask of a
reference. `pack` converts them to bytes. Small studies keep them in the page. Larger ones have one file per image
next to the page, which loads it as a script when it is shown: a page opened from disk may load nothing else.
"""

import zlib
from base64 import b64encode
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from io import BytesIO
from math import ceil, log2, prod, sqrt
from typing import Any
from zipfile import BadZipFile, ZipFile

import numpy as np
from jinja2.utils import htmlsafe_json_dumps
from markupsafe import Markup
from numpy.typing import NDArray

from glossbench.errors import InputError
from glossbench.metrics.perceptual import FLIP
from glossbench.run.results import Results
from glossbench.run.store import Store
from glossbench.strict_json import dumps

from .. import raster, style
from ..model.conditions import Cell, Group, list_methods
from ..model.errors import EPSILON, ERRORS, Floats, compute_error
from .beside import FOLDER, write_script

INLINE = 6_000_000  # largest size of all images, deflated, that are stored in the page [bytes]
FLIP_SIZE, FLIP_PIXELS = 256, 2_600_000  # largest longer side of a map, and largest sum over the maps of all cells
RANGE_SAMPLES = 1_000_000  # pixels of a group that determine the end of the error scale
LARGEST_HALF = 65504.0
Planes = NDArray[np.float16]


@dataclass(frozen=True)
class Payload:
    """The data of the viewer.

    Attributes:
        registry: groups and their images, as JSON that is safe in a page.
        blocks: base64 of the images in the page, by identifier; empty if they are files next to it.
        files: names in the folder of images next to the page.
    """

    registry: Markup
    blocks: Mapping[str, str]
    files: frozenset[str]


def build_payload(results: Results, groups: Sequence[Group], metric: str | None = None) -> Payload:
    """All images of these groups; those that are too large for the page are written to files next to it.

    Args:
        metric: the metric whose value is shown with each image.
    """
    shown = [group for group in groups if group.done]
    shapes = [results.mask(group.reference["reference_key"]).shape for group in shown]
    n_pixels = sum(h * w * len(group.done) for group, (h, w) in zip(shown, shapes, strict=True))
    longest = max((max(shape) for shape in shapes), default=1)
    reduction = max(ceil(longest / FLIP_SIZE), ceil(sqrt(n_pixels / FLIP_PIXELS)))
    held: dict[str, bytes] = {}  # until they are too many for the page
    files: set[str] = set()
    n_bytes = 0
    described = []
    hues = list_methods(shown)
    for group in shown:
        ranges: dict[str, list[Floats]] = {mode: [] for mode in ERRORS}
        entries = []
        for entry, planes in _list_images(results, group, metric, reduction, ranges, hues):
            data = pack(planes)
            name = sha256(data).hexdigest()[:20]
            if name not in held and f"{name}.js" not in files:
                held[name] = data
                n_bytes += len(data)
            if n_bytes > INLINE:
                files |= {write_script(results, *each) for each in held.items()}
                held.clear()
            entries.append(entry | {"data": name})
        described.append(_describe_group(results, group, entries, ranges))
    registry = {
        "groups": described,
        "folder": FOLDER if files else None,
        "signed": _encode_colours(raster.SIGNED),
        "unsigned": _encode_colours(raster.UNSIGNED),
        "epsilon": EPSILON,
        "flipReduction": reduction,
        "errors": [{"mode": mode, "name": name, "formula": formula} for mode, (name, formula) in ERRORS.items()],
    }
    blocks = {name: b64encode(data).decode() for name, data in held.items()}
    return Payload(htmlsafe_json_dumps(registry, dumps=dumps), blocks, frozenset(files))


def pack(planes: Planes) -> bytes:
    """Half floats (4, H, W) as deflated bytes, reordered so that they deflate well.

    Their bits as integers, modulo 2^16: green is subtracted from red and blue, each value is replaced by its difference
    from the left one, then from the one above, the sign moves to the lowest bit, and high bytes precede low ones.
    """
    bits = planes.view(np.int16).copy()
    bits[[0, 2]] -= bits[1]
    for axis in (2, 1):
        bits = np.diff(bits, axis=axis, prepend=np.int16(0))
    folded = ((bits << 1) ^ (bits >> 15)).view(np.uint16).ravel()
    return zlib.compress(np.concatenate([folded >> 8, folded & 255]).astype(np.uint8).tobytes(), 6)


def _list_images(
    results: Results,
    group: Group,
    metric: str | None,
    reduction: int,
    ranges: Mapping[str, list[Floats]],
    hues: Mapping[str, int],
) -> Iterator[tuple[dict[str, Any], Planes]]:
    """The reference and then the cells of a group; their errors are added to `ranges`."""
    key = group.reference["reference_key"]
    reference, mask = results.reference(key).astype(np.float64), results.mask(key)
    stated = {"samples": group.reference["reference_samples"], "note": _describe_noise(group)}
    yield (
        {"key": key, "kind": "reference", "name": "reference", "options": ""} | stated,
        _to_halves(reference, mask.astype(float)),
    )
    step = max(1, len(group.done) * int(mask.sum()) // RANGE_SAMPLES)
    for cell in group.done:
        image = results.image(cell.row["key"]).astype(np.float64)
        name = f"images/{cell.row['key']}_flip_{reduction}.npz"
        flip = _keep_map(results, name, mask.shape, partial(_compute_flip, image, reference, mask, reduction))
        for mode, seen in ranges.items():
            values = flip[mask] if mode == "flip" else compute_error(mode, image[mask], reference[mask])
            seen.append(values[::step].astype(np.float64))
        yield (
            _make_entry(cell, metric) | {"colour": style.shade(hues[str(cell.row["method"])])},
            _to_halves(image, flip),
        )


def _make_entry(cell: Cell, metric: str | None) -> dict[str, Any]:
    row = cell.row
    value = row.get(metric) if metric else None
    note = "at the noise floor" if row["at_noise_floor"] else f"{metric} {style.format_number(value)}" if metric else ""
    return {
        "key": row["key"],
        "kind": "cell",
        "name": row["method"],
        "options": cell.options,
        "samples": row["n_samples"],
        "note": note,
    }


def _describe_group(
    results: Results,
    group: Group,
    entries: Sequence[Mapping[str, Any]],
    ranges: Mapping[str, Sequence[Floats]],
) -> dict[str, Any]:
    key = group.reference["reference_key"]
    mask = results.mask(key)
    exposure = raster.choose_exposure(results.reference(key).astype(np.float64), mask)
    return {
        "title": group.title,
        "width": mask.shape[1],
        "height": mask.shape[0],
        "stops": log2(exposure),
        "ranges": {mode: raster.find_error_limit(errors) for mode, errors in ranges.items()},
        "images": [dict(entry) for entry in entries],
    }


def _describe_noise(group: Group) -> str:
    return f"noise {style.format_number(group.reference['reference_noise'], 2)}"


def _to_halves(radiance: Floats, fourth: Floats) -> Planes:
    """Planes (4, H, W); values above the range of a half float become its largest value, and NaN becomes 0."""
    four = np.concatenate([radiance, fourth[..., None]], axis=2).transpose(2, 0, 1)
    return np.clip(np.nan_to_num(four, nan=0.0), -LARGEST_HALF, LARGEST_HALF).astype(np.float16)


def _keep_map(results: Results, name: str, shape: tuple[int, ...], make: Callable[[], Floats]) -> Floats:
    """A map in steps of 1/256, computed for the first page of these results, or again if its file is damaged."""
    steps = _read_stored(results.store, name, shape)
    if steps is None:
        steps = (256 * make()).astype(np.uint16)
        coded = BytesIO()
        np.savez_compressed(coded, steps=steps)
        results.store.put(name, coded.getvalue())
    return steps / 256


def _read_stored(store: Store, name: str, shape: tuple[int, ...]) -> NDArray[np.uint16] | None:
    """The steps in a file of a map; None if there is no complete file of this shape."""
    try:
        coded = store.get(name)
        with ZipFile(BytesIO(coded)) as file:  # a ZIP file has checksums
            if sum(member.file_size for member in file.infolist()) > 2 * prod(shape) + 1000 or file.testzip():
                return None
        with np.load(BytesIO(coded), allow_pickle=False) as kept:
            steps: NDArray[np.uint16] = kept["steps"]
    except InputError:
        raise
    except (OSError, ValueError, KeyError, EOFError, BadZipFile, NotImplementedError, RuntimeError, zlib.error):
        return None
    return steps if steps.dtype == np.uint16 and steps.shape == shape else None


def _compute_flip(image: Floats, reference: Floats, mask: raster.Mask, n: int) -> Floats:
    """The FLIP map in steps of 1/256; for n > 1 of the means of n x n pixels, seen under the same visual angle."""
    if n == 1:
        return np.round(256 * FLIP().errors(image, reference, mask)) / 256
    size = max(mask.shape) // n
    x, y = (raster.downscale(each, mask, size)[0].astype(np.float64) for each in (image, reference))
    small = raster.downscale(np.ones((*mask.shape, 1)), mask, size)[1] >= 0.5
    errors = FLIP(pixels_per_degree=max(1.0, FLIP().pixels_per_degree * size / max(mask.shape))).errors(x, y, small)
    rows, columns = ((np.arange(n) * m) // n for n, m in zip(mask.shape, small.shape, strict=True))
    return np.round(256 * errors)[np.ix_(rows, columns)] / 256


def _encode_colours(colours: Any) -> str:
    """The 255 colours of a colour map, as base64 of RGB bytes."""
    return b64encode(np.round(255 * colours(range(255))[:, :3]).astype(np.uint8).tobytes()).decode()
