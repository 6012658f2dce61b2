"""HDR image files: `.hdr` (Radiance RGBE) and `.exr` (OpenEXR) to a tensor, and a tensor to `.exr`.

Images are (H, W, C), row 0 at the top, linear radiance, float32. What a file holds is checked here, once, so
that whoever gets a tensor has an image that is finite and not negative.
"""

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from uuid import uuid4

import numpy as np
import OpenEXR
import OpenImageIO as oiio
import torch
from torch import Tensor

from glossbench.errors import InputError

# First bytes of a file, by extension. The reading library would take a PNG that is called .hdr.
_MAGIC = {".hdr": (b"#?RADIANCE", b"#?RGBE"), ".exr": (b"\x76\x2f\x31\x01",)}
_KIND = {".hdr": "a Radiance HDR image", ".exr": "an OpenEXR image"}
_MAX_PIXELS = 2**28  # 3 GB as float32 RGB: a larger header is damaged, not ambitious


def read_image(path: str | Path) -> Tensor:
    """Radiance (H, W, 3), float32, of an .hdr or .exr file: `read_pixels` of an image fit to be a light.

    Raises:
        InputError: as `read_pixels`, and for a value that is NaN, infinite or negative.
    """
    image = read_pixels(path)
    _check_radiance(Path(path), image)
    return image


def read_pixels(path: str | Path) -> Tensor:
    """The image (H, W, 3), float32, of an .hdr or .exr file, row 0 at the top.

    Channels R, G, B; of a file without these the first three, or its one channel three times. Alpha and all
    else is dropped. The image is the data window of an EXR, whatever its display window.

    Raises:
        InputError: no such file, another or damaged format, truncated, no pixels or more than 2^28.
    """
    path = Path(path)
    kind = _checked_kind(path)
    source = oiio.ImageInput.open(str(path))
    if source is None:
        raise _damaged(path, kind, oiio.geterror)
    try:
        spec = source.spec()
        if spec.deep:
            raise InputError(f"{path}: a deep image has no single radiance per pixel; flatten it first")
        if spec.width * spec.height > _MAX_PIXELS:
            size = f"{spec.width} x {spec.height}"
            raise InputError(f"{path}: must have at most {_MAX_PIXELS} pixels, its header claims {size}")
        pixels = source.read_image(oiio.FLOAT)
        if pixels is None:
            raise _damaged(path, kind, source.geterror)
    finally:
        source.close()
    upright = _upright(path, np.asarray(pixels), spec.get_int_attribute("Orientation", 1))
    return torch.from_numpy(np.ascontiguousarray(upright[..., _rgb(list(spec.channelnames))]))


def write_exr(path: str | Path, image: Tensor, channels: Sequence[str] = ("R", "G", "B")) -> None:
    """Writes an image (H, W, C) as float32 OpenEXR, one name a channel; the same image gives the same bytes.

    The file appears under its name whole or not at all: it is written beside it, then renamed.

    Raises:
        InputError: a shape that does not fit the channels, another extension, or a folder that cannot be
            written.
    """
    path = Path(path)
    if path.suffix.lower() != ".exr":
        raise InputError(f"{path}: the extension must be .exr, got {path.suffix!r}")
    if image.dim() != 3 or image.shape[2] != len(set(channels)) or not image.numel():
        shape = tuple(image.shape)
        raise InputError(f"{path}: channels {tuple(channels)} need an image (H, W, {len(channels)}), got {shape}")
    planes = image.detach().cpu().float().numpy()
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    content = {name: np.ascontiguousarray(planes[..., i]) for i, name in enumerate(channels)}
    part = path.with_name(f".{path.name}.{uuid4().hex}.part")
    try:
        # The OpenEXR library reports a missing folder in its own words; the system's are clearer.
        part.touch()
        OpenEXR.File(header, content).write(str(part))
        os.replace(part, path)
    except (OSError, RuntimeError) as error:
        reason = (isinstance(error, OSError) and error.strerror) or " ".join(str(error).split())
        raise InputError(f"{path}: cannot be written: {reason}") from None
    finally:
        part.unlink(missing_ok=True)


def _checked_kind(path: Path) -> str:
    """What the file says it is, in words; InputError where its name, its first bytes or the disk disagree."""
    suffix = path.suffix.lower()
    if suffix not in _MAGIC:
        raise InputError(f"{path}: unknown extension {path.suffix!r}; known: {', '.join(_MAGIC)}")
    if path.is_dir():
        raise InputError(f"{path}: must be an image file, is a folder")
    if not path.exists():
        raise InputError(f"{path}: no such file")
    if not path.is_file():
        raise InputError(f"{path}: must be an image file, is a device or pipe")
    try:
        with path.open("rb") as file:
            head = file.read(16)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    if not head:
        raise InputError(f"{path}: is empty (0 bytes)")
    if not head.startswith(_MAGIC[suffix]):
        raise InputError(f"{path}: is not {_KIND[suffix]}: it begins with {head[:8]!r}")
    return _KIND[suffix]


def _damaged(path: Path, kind: str, last_error: Callable[[], str]) -> InputError:
    try:
        detail = last_error()
    except UnicodeDecodeError:
        detail = "unreadable header"  # the library quotes the damaged bytes
    # It repeats the path, and may report one fault in several lines: the first says what happened.
    first = next((line for line in detail.strip().splitlines() if line), "no reason given")
    return InputError(f"{path}: is truncated or damaged as {kind}: {first.replace(f'({path})', '').strip()}")


def _rgb(names: list[str]) -> list[int]:
    if {"R", "G", "B"} <= set(names):
        return [names.index(c) for c in "RGB"]
    return [0, 1, 2] if len(names) >= 3 else [0, 0, 0]


def _upright(path: Path, pixels: np.ndarray, orientation: int) -> np.ndarray:
    """Pixels with row 0 at the top and column 0 at the left; orientation as in TIFF and EXIF."""
    if orientation > 4:
        raise InputError(f"{path}: must be stored row by row (-Y +X and the like), is stored column by column")
    rows, columns = {2: (1, -1), 3: (-1, -1), 4: (-1, 1)}.get(orientation, (1, 1))
    return pixels[::rows, ::columns]


def _check_radiance(path: Path, image: Tensor) -> None:
    for rule, bad in (("finite", ~torch.isfinite(image)), ("not negative", image < 0)):
        n_bad = int(bad.any(2).sum())
        if n_bad:
            row, column = bad.any(2).nonzero()[0].tolist()
            value = image[row, column][bad[row, column]][0].item()
            where = f"first at row {row}, column {column}: {value:g}"
            raise InputError(f"{path}: radiance must be {rule}, but {n_bad} pixels are not, {where}")
