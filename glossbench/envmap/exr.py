"""OpenEXR images: scanline or tiled, single- or multi-part, with MIP levels or without, to an array, and back."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import OpenEXR
import OpenImageIO as oiio
from torch import Tensor

from glossbench.atomic import replacing
from glossbench.envmap.refusals import check_size, damaged, last_error
from glossbench.errors import CannotWrite, InputError, nearest

KIND = "an OpenEXR image"


def read_exr(path: Path, layer: str | None = None) -> np.ndarray:
    """Colour (H, W, 3), float32, of the data window: level 0, whatever the display window.

    Channels R, G, B of the named layer: `layer.R` and so on, or the part of that name. Without a name those of the
    first part that has bare R, G, B; else of the first layer; else the first three channels of the first part, or
    its one channel three times. Unsigned integers become the number that they are. The other parts and levels are
    read too, and dropped: a file cut short is refused wherever the cut is.

    Raises:
        InputError: damaged, too large, deep, luminance and chroma (Y, RY, BY), or no such layer.
    """
    source = oiio.ImageInput.open(str(path))
    if source is None:
        raise damaged(path, KIND, last_error(oiio.geterror))
    try:
        part, channels = _colour(path, _parts(path, source), layer)
        image = _whole(path, source, part)
    finally:
        source.close()
    return np.ascontiguousarray(image[..., channels])


def write_exr(path: str | Path, image: Tensor, channels: Sequence[str] = ("R", "G", "B")) -> None:
    """Writes an image (H, W, C) as float32 OpenEXR, one name a channel; the same image gives the same bytes.

    The file appears under its name whole or not at all.

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
    try:
        with replacing(path) as part:
            # The OpenEXR library reports a missing folder in its own words; the system's are clearer.
            part.touch()
            OpenEXR.File(header, content).write(str(part))
    except RuntimeError as error:
        reason = " ".join(str(error).replace(str(part), path.name).split())
        raise CannotWrite(path, reason) from None


def _parts(path: Path, source: oiio.ImageInput) -> list[oiio.ImageSpec]:
    """The header of every part, none of them too large."""
    parts: list[oiio.ImageSpec] = []
    while source.seek_subimage(len(parts), 0):
        parts.append(source.spec())
        check_size(path, KIND, parts[-1].width, parts[-1].height)
    last_error(source.geterror)  # that there is no further part
    return parts


def _colour(path: Path, parts: list[oiio.ImageSpec], layer: str | None) -> tuple[int, list[int]]:
    """(part, its channels) that are the colour."""
    colours: dict[str, tuple[int, list[int]]] = {}  # by layer; "" is that of bare R, G, B
    for part, spec in enumerate(parts):
        names = list(spec.channelnames)
        for prefix in dict.fromkeys(name.rpartition(".")[0] for name in names):
            wanted = [f"{prefix}.{c}" if prefix else c for c in "RGB"]
            if set(wanted) <= set(names):
                found = part, [names.index(c) for c in wanted]
                title = spec.get_string_attribute("name") if len(parts) > 1 else ""
                for key in (prefix, *([title] if title and not prefix else [])):
                    colours.setdefault(key, found)
    if layer is not None:
        if layer not in colours:
            raise InputError(f"{path}: has no layer {layer!r} with R, G, B{nearest(layer, colours)}")
        part, channels = colours[layer]
    elif colours:
        part, channels = colours.get("") or next(iter(colours.values()))
    else:
        part, names = 0, list(parts[0].channelnames)
        if {"RY", "BY"} & set(names):
            raise InputError(f"{path}: holds luminance and chroma (Y, RY, BY), not R, G, B; convert it first")
        channels = [0, 1, 2] if len(names) >= 3 else [0, 0, 0]
    if parts[part].deep:
        raise InputError(f"{path}: a deep image has no single radiance per pixel; flatten it first")
    return part, channels


def _whole(path: Path, source: oiio.ImageInput, wanted: int) -> np.ndarray:
    """All channels of one part at level 0, after every level of every part was there to be read."""
    image = None
    part = level = 0
    while source.seek_subimage(part, level):
        spec = source.spec()
        if not spec.deep:
            pixels = source.read_image(part, level, 0, spec.nchannels, oiio.FLOAT)
            if pixels is None:
                raise damaged(path, KIND, last_error(source.geterror))
            if (part, level) == (wanted, 0):
                formats = spec.channelformats or (spec.format,) * spec.nchannels
                # The library maps integers to [0, 1].
                image = np.asarray(pixels) * np.where([f == oiio.UINT32 for f in formats], 2.0**32 - 1, 1.0)
        part, level = (part, level + 1) if source.seek_subimage(part, level + 1) else (part + 1, 0)
    last_error(source.geterror)
    assert image is not None  # the part was found by the same walk
    return image.astype(np.float32)
