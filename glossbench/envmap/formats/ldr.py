"""Images of integers (.png, .jpg, .tif) as linear radiance, only on request; TIFF of floats, which is radiance."""

from math import prod
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from glossbench.envmap.formats.image_content import ImageContent
from glossbench.envmap.formats.refusals import check_fits, check_size, make_damage_error, take_last_error
from glossbench.errors import InputError
from glossbench.srgb import decode

KINDS = {".png": "a PNG image", ".jpg": "a JPEG image", ".jpeg": "a JPEG image", ".tif": "a TIFF image",
         ".tiff": "a TIFF image"}  # fmt: skip
# The library accepts an image whose pixels are complete although its end is missing.
_END = {b"\x89PNG": b"IEND\xaeB`\x82", b"\xff\xd8\xff": b"\xff\xd9"}
_PIXELS_A_BYTE = 2000  # pixels per byte of a file: no coding of colour packs more; deflate packs about 350
_INTEGERS = {oiio.UINT8: 2**8, oiio.UINT16: 2**16}
_FLOATS = (oiio.HALF, oiio.FLOAT, oiio.DOUBLE)
_SRGB_IN_CICP = (1, 13)  # primaries and curve


def read_ldr(path: Path, ldr: bool) -> ImageContent:
    """Colour (H, W, 3), float32; grey is repeated three times; alpha is dropped, and colour is not multiplied by it.

    Floats are radiance. Integers of 8 or 16 bits are mapped to [0, 1], then decoded from sRGB or from the power that a
    PNG states.

    Raises:
        InputError: the image has integers and `ldr` is false, or other integers; it is damaged or too large, or its
            coding of colour is not supported.
    """
    kind = KINDS[path.suffix.lower()]
    with path.open("rb") as file:
        magic = file.read(4)
        n_bytes = file.seek(0, 2)
        file.seek(max(n_bytes - 1024, 0))
        tail = file.read()
    if any(magic.startswith(start) and end not in tail for start, end in _END.items()):
        raise make_damage_error(path, kind, "its end is missing")
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    source = oiio.ImageInput.open(str(path), config)
    if source is None:
        raise make_damage_error(path, kind, take_last_error(oiio.geterror))
    try:
        spec = source.spec()
        check_size(path, kind, spec.width, spec.height)
        if spec.width * spec.height > _PIXELS_A_BYTE * n_bytes:
            raise make_damage_error(path, kind, f"{n_bytes} bytes cannot hold {spec.width} x {spec.height} pixels")
        _check_coding(path, spec, ldr)
        check_fits(path, spec.width, spec.height)
        pixels = source.read_image(spec.format if spec.format.basetype in _INTEGERS else oiio.FLOAT)
        if pixels is None or source.has_error:
            raise make_damage_error(path, kind, take_last_error(source.geterror))
        notes = ["the first of its pages is read"] if source.seek_subimage(1, 0) else []
        take_last_error(source.geterror)  # clears the error that there is no further page
    finally:
        source.close()
    image = _turn_upright(pixels[..., [0, 1, 2] if spec.nchannels > 2 else [0, 0, 0]], spec)
    if spec.format.basetype in _FLOATS:
        return ImageContent(np.ascontiguousarray(image), tuple(notes))
    n_values = _INTEGERS[spec.format.basetype]
    linear, notes_of_colour = _linearize(spec, np.arange(n_values) / (n_values - 1))
    return ImageContent(linear.astype(np.float32)[image], (*notes, *notes_of_colour))


def _check_coding(path: Path, spec: oiio.ImageSpec, ldr: bool) -> None:
    """Raises InputError if the coding of colour is not supported, or the values are integers and `ldr` is false."""
    colour = spec.get_string_attribute("tiff:ColorSpace")
    if colour.startswith("LOG") or colour.endswith("LAB"):
        name = f"SGI {colour.title()}" if colour.startswith("LOG") else colour
        raise InputError(f"{path}: holds {name}, which is not read; convert it to .exr")
    base = spec.format.basetype
    if base in _FLOATS:
        return
    if base not in _INTEGERS:
        raise InputError(f"{path}: holds integers of the type {spec.format}; convert them to floats or .exr")
    if not ldr:
        raise make_ldr_error(path)
    cicp = spec.getattribute("CICP")
    if cicp is not None and tuple(cicp[:2]) != _SRGB_IN_CICP:
        raise InputError(f"{path}: states the colours CICP {tuple(cicp)}, which are not read; convert it to .exr")


def make_ldr_error(path: Path) -> InputError:
    """The error for an image of integers without `ldr`."""
    return InputError(f"{path}: is not a high-dynamic-range image; to use its integers as radiance set ldr: true")


def _linearize(spec: oiio.ImageSpec, values: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Linear light of values in [0, 1], and notes."""
    notes = []
    profile = spec.get_string_attribute("ICCProfile:profile_description")
    if spec.getattribute("ICCProfile") is not None and "sRGB" not in profile:
        notes.append(f"its colour profile {profile!r} is not applied: its values are taken for sRGB")
    space, gamma = spec.get_string_attribute("oiio:ColorSpace"), spec.get_float_attribute("oiio:Gamma")
    if space.startswith("lin_"):
        return values, ["its integers are linear, as it states"]
    # Programs that write sRGB state it as the number 2.2.
    if gamma and abs(gamma - 2.2) > 0.01:
        return values**gamma, [*notes, f"decoded by the power {gamma:.4g} that it states"]
    return decode(values), notes


def _turn_upright(pixels: np.ndarray, spec: oiio.ImageSpec) -> np.ndarray:
    """Pixels in upright order, whatever the orientation in the file is."""
    orientation = spec.get_int_attribute("Orientation", 1)
    if orientation == 1 or prod(pixels.shape) == 0:
        return pixels
    stored = oiio.ImageBuf(np.ascontiguousarray(pixels))
    stored.specmod().attribute("Orientation", orientation)
    return np.asarray(oiio.ImageBufAlgo.reorient(stored).get_pixels(stored.spec().format))
