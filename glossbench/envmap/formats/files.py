"""Reads image files to a tensor: OpenEXR, Radiance HDR, TIFF, portable float maps, DDS cube maps; integers on request.

Images are (H, W, 3), row 0 at the top, linear radiance, float32.
"""

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from glossbench.envmap.formats import dds, exr, hdr, ldr, pfm
from glossbench.envmap.formats.exr import write_exr
from glossbench.envmap.formats.image_content import ImageContent
from glossbench.envmap.formats.radiance import fit_to_be_light
from glossbench.envmap.formats.signatures import advise, recognise
from glossbench.errors import InputError

__all__ = ["read_file", "read_image", "read_pixels", "write_exr"]

# Format by extension. The first bytes must agree: without this check a library would read a PNG named .hdr.
_FLOATS = {".exr": exr.KIND, ".hdr": hdr.KIND, ".pfm": pfm.KIND, ".dds": dds.KIND, ".tif": ldr.KINDS[".tif"]}


def read_image(path: str | Path, layer: str | None = None, ldr: bool = False) -> Tensor:
    """Radiance (H, W, 3), float32: the image of a file, checked so that it can be a light.

    Raises:
        InputError: as `read_file`, or a value is NaN, infinite or negative.
    """
    image = read_file(path, layer, ldr).image
    fit_to_be_light(Path(path), image)
    return torch.from_numpy(image)


def read_pixels(path: str | Path, layer: str | None = None, ldr: bool = False) -> Tensor:
    """The image (H, W, 3), float32, of a file, row 0 at the top; alpha and other channels are dropped."""
    return torch.from_numpy(read_file(path, layer, ldr).image)


def read_file(path: str | Path, layer: str | None = None, ldr: bool = False) -> ImageContent:
    """The image of a file, with notes about how it was read.

    Args:
        layer: the layer or part to read from an EXR with several.
        ldr: accept an image of integers and decode it from sRGB.

    Raises:
        InputError: the file does not exist, has another format, is damaged or truncated, or has no pixels or more than
            2^28.
    """
    path = Path(path)
    suffix = _check_suffix(path, ldr)
    if layer is not None and suffix != ".exr":
        raise InputError(f"{path}: only an OpenEXR image has layers, got layer {layer!r}")
    try:
        # A value that overflows becomes infinite; the caller decides whether this is an error.
        with np.errstate(over="ignore", invalid="ignore"):
            decoded = _decode(path, suffix, layer, ldr)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    return decoded._replace(image=np.ascontiguousarray(decoded.image))


def _decode(path: Path, suffix: str, layer: str | None, is_ldr: bool) -> ImageContent:
    if suffix == ".exr":
        return exr.read_exr(path, layer)
    if suffix in ldr.KINDS:
        return ldr.read_ldr(path, is_ldr)
    return {".hdr": hdr.read_hdr, ".pfm": pfm.read_pfm, ".dds": dds.read_dds}[suffix](path)


def _check_suffix(path: Path, is_ldr: bool) -> str:
    """The extension; InputError if it is unknown, the file cannot be read, or its first bytes are of another format."""
    suffix = path.suffix.lower()
    kind = (_FLOATS | ldr.KINDS).get(suffix)
    if suffix in (".png", ".jpg", ".jpeg") and not is_ldr:
        raise ldr.make_ldr_error(path)
    if kind is None and not path.is_file():
        raise InputError(f"{path}: unknown extension {path.suffix!r}; known: {', '.join(_FLOATS)}")
    if path.is_dir():
        raise InputError(f"{path}: must be an image file, but is a folder")
    if not path.exists():
        raise InputError(f"{path}: no such file")
    if not path.is_file():
        raise InputError(f"{path}: must be an image file, but is a device or a pipe")
    try:
        with path.open("rb") as file:
            head = file.read(24)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    begins = f"it begins with {head[:8]!r}{advise(head)}"
    if kind is None:
        raise InputError(f"{path}: unknown extension {path.suffix!r}; known: {', '.join(_FLOATS)}; {begins}")
    if not head:
        raise InputError(f"{path}: is empty (0 bytes)")
    found = recognise(head)
    if found is None or found.kind != kind:
        raise InputError(f"{path}: is not {kind}: {begins}")
    return suffix
