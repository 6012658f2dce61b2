"""Reads and writes OpenEXR images: scanline or tiled, single- or multi-part, with MIP levels or without."""

import io
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import OpenEXR
import OpenImageIO as oiio
from torch import Tensor

from glossbench.atomic import replacing
from glossbench.envmap.formats.chromaticities import convert_to_rec709
from glossbench.envmap.formats.exr_layers import Layer, choose_layer
from glossbench.envmap.formats.image_content import Covering, ImageContent
from glossbench.envmap.formats.refusals import check_fits, check_size, make_damage_error, take_last_error
from glossbench.errors import InputError

KIND = "an OpenEXR image"
_BLOCK = 2**26  # bytes of pixels read at a time
_PROJECTION, _AXES = "glossbench:projection", "glossbench:axes"  # attributes that `write_exr` adds
# Projection and axes by the library's names for the values of the format's own attribute.
_ENVMAP = {"LatLong Environment": ("lat_long", "mitsuba"), "CubeFace Environment": ("openexr_cube", "forward")}
_LAT_LONG_NOTE = "by its attribute envmap +z is in the centre, -x right of it (axes mitsuba); `axes: forward` wins"


def read_exr(path: Path, layer: str | None = None) -> ImageContent:
    """Radiance (H, W, 3), float32, of level 0 of the display window; pixels outside the data window are black.

    It is read from a named layer, or from the layer that holds all of the light (see `exr_layers`). Unsigned integers
    keep their value. Colour is converted from `chromaticities` to linear Rec. 709. It is used as stored: it is
    premultiplied by alpha, so transparent pixels are black. The other parts and levels are read and dropped, so that
    a truncated file is refused wherever it ends. `whiteLuminance`, an absolute unit, and `worldToCamera`, which has no
    meaning for a picture of all directions, are ignored.

    How it covers the sphere is stated by the attributes that `write_exr` writes, or by the format's own `envmap`.

    Raises:
        InputError: the file is damaged, too large, deep or of luminance and chroma (Y, RY, BY); it has no such layer,
            no colour, or no pixel inside the display window.

    Source: OpenEXR, "Technical Introduction" (windows, premultiplied alpha), "Standard Attributes", ImfEnvmap.h.
    """
    source = oiio.ImageInput.open(str(path))
    if source is None:
        raise _make_open_error(path, take_last_error(oiio.geterror))
    try:
        parts = _read_parts(path, source)
        chosen, notes = choose_layer(path, parts, layer)
        spec = parts[chosen.part]
        if spec.deep:
            raise InputError(f"{path}: a deep image has no single radiance per pixel; flatten it first")
        notes += _compare_windows(path, spec) + _note_pixel_shape(spec)
        check_fits(path, spec.full_width, spec.full_height)
        image, n_transparent = _read_picture(path, source, spec, chosen)
    finally:
        source.close()
    if n_transparent:
        notes += (f"alpha is below 1 in {n_transparent} pixels: their colour counts as stored, with black behind it",)
    stated = spec.getattribute("chromaticities")
    if stated is not None and len(set(chosen.channels)) > 1:
        pairs = tuple(zip(stated[::2], stated[1::2], strict=True))
        told = "the chromaticities " + " ".join(f"({x:.4g}, {y:.4g})" for x, y in pairs)
        image, more = convert_to_rec709(image, pairs, told)
        notes += more
    return ImageContent(image, notes, _read_covering(spec))


def write_exr(
    path: str | Path,
    image: Tensor,
    channels: Sequence[str] = ("R", "G", "B"),
    covers: Covering | None = None,
) -> None:
    """Writes an image (H, W, C) as float32 OpenEXR, one name per channel; the same image gives the same bytes.

    The file appears under its name whole or not at all. `covers` is written if given; for lat_long with the axes of
    mitsuba it is also written as the format's own `envmap`, which has the same meaning.

    Raises:
        InputError: the shape does not fit the channels, the extension is not .exr, or the folder cannot be written.
    """
    path = Path(path)
    check_exr_name(path)
    try:
        coded = encode_exr(image, channels, covers)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    with replacing(path) as part:
        part.write_bytes(coded)


def encode_exr(image: Tensor, channels: Sequence[str] = ("R", "G", "B"), covers: Covering | None = None) -> bytes:
    """The bytes of the file that `write_exr` writes.

    Raises:
        InputError: the shape does not fit the channels, or the library refuses the image.
    """
    if image.dim() != 3 or image.shape[2] != len(set(channels)) or not image.numel():
        shape = tuple(image.shape)
        raise InputError(f"channels {tuple(channels)} need an image (H, W, {len(channels)}), got {shape}")
    planes = image.detach().cpu().float().numpy()
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    if covers is not None:
        header |= {_PROJECTION: covers.projection, _AXES: covers.axes}
        if (covers.projection, covers.axes) == _ENVMAP["LatLong Environment"]:
            header["envmap"] = OpenEXR.ENVMAP_LATLONG
    content = {name: np.ascontiguousarray(planes[..., i]) for i, name in enumerate(channels)}
    coded = io.BytesIO()  # encoded in memory: the file is then written in one step, and a full disk raises an error
    try:
        OpenEXR.File(header, content).write(coded)
    except RuntimeError as error:
        raise InputError(" ".join(str(error).split())) from None
    return coded.getvalue()


def check_exr_name(path: Path) -> None:
    """Raises InputError if a path to write does not end in .exr, is a folder, or is in a folder that does not exist."""
    if path.suffix.lower() != ".exr":
        raise InputError(f"{path}: the extension must be .exr, got {path.suffix!r}")
    if path.is_dir():
        raise InputError(f"{path}: must be a file, but is a folder")
    if not path.parent.is_dir():
        raise InputError(f"{path}: cannot be written: No such file or directory")


def _make_open_error(path: Path, reason: str) -> InputError:
    """The error for a file that the library does not open."""
    subsampled = re.findall(r'Subsampled channels are not supported \(channel "([^"]*)"', reason)
    if subsampled:
        chroma = "luminance and chroma (Y, RY, BY), not R, G, B" if {"RY", "BY"} & set(subsampled) else ""
        what = chroma or f"channels of fewer pixels than the others ({', '.join(subsampled)})"
        return InputError(f"{path}: holds {what}; convert it to R, G, B first")
    return make_damage_error(path, KIND, reason)


def _read_parts(path: Path, source: oiio.ImageInput) -> list[oiio.ImageSpec]:
    """The header of every part; InputError if one is too large."""
    parts: list[oiio.ImageSpec] = []
    while source.seek_subimage(len(parts), 0):
        parts.append(source.spec())
        check_size(path, KIND, parts[-1].width, parts[-1].height)
        check_size(path, KIND, parts[-1].full_width, parts[-1].full_height)
    take_last_error(source.geterror)  # clears the error that there is no further part
    return parts


def _compare_windows(path: Path, spec: oiio.ImageSpec) -> tuple[str, ...]:
    """A note if data window and display window differ; InputError if they do not overlap."""
    data, display = (
        (spec.x, spec.y, spec.width, spec.height),
        (spec.full_x, spec.full_y, spec.full_width, spec.full_height),
    )
    if data == display:
        return ()
    where = "its data window is {2} x {3} at ({0}, {1})".format(*data)
    where += ", its display window {2} x {3} at ({0}, {1})".format(*display)
    inside = _find_overlap(spec)
    if min(inside[2] - inside[0], inside[3] - inside[1]) < 1:
        raise InputError(f"{path}: no pixel is within the picture: {where}")
    return (f"the picture is the display window, black without data: {where}",)


def _find_overlap(spec: oiio.ImageSpec) -> tuple[int, int, int, int]:
    """(first column, first row, end column, end row) of the pixels that are in the display window."""
    return (
        max(spec.x, spec.full_x),
        max(spec.y, spec.full_y),
        min(spec.x + spec.width, spec.full_x + spec.full_width),
        min(spec.y + spec.height, spec.full_y + spec.full_height),
    )


def _note_pixel_shape(spec: oiio.ImageSpec) -> tuple[str, ...]:
    aspect = spec.get_float_attribute("PixelAspectRatio", 1.0)
    return () if abs(aspect - 1) < 1e-3 else (f"its pixelAspectRatio of {aspect:g} is ignored",)


def _read_covering(spec: oiio.ImageSpec) -> Covering | None:
    """How the picture covers the sphere, if the header states it."""
    projection = spec.get_string_attribute(_PROJECTION)
    if projection:
        return Covering(projection, spec.get_string_attribute(_AXES) or "forward", f"its attribute {_PROJECTION}")
    stated = spec.get_string_attribute("textureformat")
    if stated not in _ENVMAP:
        return None
    projection, axes = _ENVMAP[stated]
    return Covering(projection, axes, "its attribute envmap", _LAT_LONG_NOTE if projection == "lat_long" else "")


def _read_picture(path: Path, source: oiio.ImageInput, wanted: oiio.ImageSpec, layer: Layer) -> tuple[np.ndarray, int]:
    """The picture (H, W, 3) and the number of its transparent pixels; the rest of the file is read too, as a check."""
    used = [*layer.channels, *([] if layer.alpha is None else [layer.alpha])]
    first, end = min(used), max(used) + 1
    formats = wanted.channelformats or (wanted.format,) * wanted.nchannels
    # The library maps integers to [0, 1].
    scale = np.array([2.0**32 - 1 if formats[c] == oiio.UINT32 else 1 for c in layer.channels], np.float32)
    image = np.zeros((wanted.full_height, wanted.full_width, 3), np.float32)
    left, top, right, bottom = _find_overlap(wanted)
    n_transparent = 0
    part = level = 0
    while source.seek_subimage(part, level):
        spec = source.spec()
        is_wanted = (part, level) == (layer.part, 0)
        channels = (first, end) if is_wanted else (0, 1)
        step = _choose_block(spec, channels[1] - channels[0])
        for row in [] if spec.deep else range(spec.y, spec.y + spec.height, step):
            last = min(row + step, spec.y + spec.height)
            pixels = _read_rows(source, spec, part, level, row, last, channels)
            if pixels is None:
                raise make_damage_error(path, KIND, take_last_error(source.geterror))
            rows = slice(max(row, top) - row, min(last, bottom) - row)
            if is_wanted and rows.start < rows.stop:
                shown = pixels[rows, left - spec.x : right - spec.x]
                at = row + rows.start - spec.full_y
                image[at : at + len(shown), left - spec.full_x : right - spec.full_x] = (
                    shown[..., [c - first for c in layer.channels]] * scale
                )
                if layer.alpha is not None:
                    n_transparent += int((shown[..., layer.alpha - first] < 1).sum())
        part, level = (part, level + 1) if source.seek_subimage(part, level + 1) else (part + 1, 0)
    take_last_error(source.geterror)
    return image, n_transparent


def _choose_block(spec: oiio.ImageSpec, n_channels: int) -> int:
    """Number of rows to read at a time, about 64 MB: whole tiles, or whole blocks of rows that are coded together."""
    together = spec.tile_height or spec.get_int_attribute("oiio:RowsPerChunk", 1)
    return max(1, _BLOCK // (4 * n_channels * spec.width * together)) * together


def _read_rows(
    source: oiio.ImageInput, spec: oiio.ImageSpec, part: int, level: int, row: int, end: int, channels: tuple[int, int]
) -> np.ndarray | None:
    if spec.tile_height:
        columns = spec.x, spec.x + spec.width
        return source.read_tiles(part, level, *columns, row, end, 0, 1, *channels, oiio.FLOAT)
    return source.read_scanlines(part, level, row, end, 0, *channels, oiio.FLOAT)
