"""The light of an image file, and the light that one word means."""

import hashlib
import json
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
from pydantic import Field
from torch import Tensor

from glossbench.catalog.locate import locate
from glossbench.envmap.cubemap import CubeMap
from glossbench.envmap.formats.files import read_file
from glossbench.envmap.formats.image_content import ImageContent
from glossbench.envmap.formats.radiance import Invalid, fit_to_be_light
from glossbench.envmap.lights.facts import LightFacts, collect_facts
from glossbench.envmap.lights.light import LIGHTS, Light
from glossbench.envmap.projections.axes import Axes
from glossbench.envmap.projections.conversion import Projection, to_cubemap
from glossbench.envmap.projections.covering import CoveringChoice, resolve_covering
from glossbench.file_guard import unchanged
from glossbench.options import Resolution


@LIGHTS.register("file")
class FileLight(Light):
    """Radiance of an image file: .exr, .hdr, .tif, .pfm or .dds; with `ldr` also an image of integers.

    Attributes:
        file: path of the image; a relative one is searched in the current folder, the folder of the study and below
            GLOSSBENCH_DATA.
        resolution: texels along the edge of a face, a power of two; by default the one nearest to the image's.
        projection: how the image covers the sphere; by default what the file states, else recognised from its shape.
        axes: the axis convention of the image; by default what the file states, else forward (-z) is in the centre (see
            the module axes).
        flip_vertical: whether the first row of the image looks straight down.
        scale: factor on the radiance.
        layer: the layer or part that is the light, in an .exr with several.
        ldr: accept a .png, .jpg or .tif of 8 or 16 bits and decode it from sRGB, although its range is low.
        invalid: "refuse" an image with a value that is NaN, infinite, above 1e30 or negative, or "clamp": values that
            are too large become the largest valid value, negative ones and NaN become 0; a note states how many.
    """

    file: str
    resolution: Resolution | None = None
    projection: Projection | None = None
    axes: Axes | None = None
    flip_vertical: bool = False
    scale: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 1.0
    layer: str | None = None
    ldr: bool = False
    invalid: Invalid = "refuse"

    @cached_property
    def _decoded(self) -> ImageContent:
        """The content of the file, from which everything below follows."""
        path = locate(self.file)
        decoded = read_file(path, self.layer, self.ldr)
        if self.scale != 1:
            decoded.image[...] *= np.float32(self.scale)
        return decoded._replace(notes=decoded.notes + fit_to_be_light(path, decoded.image, self.invalid))

    @cached_property
    def _covered(self) -> CoveringChoice:
        """How the image covers the sphere."""
        return resolve_covering(self._decoded.covers, self.projection, self.axes, *self._decoded.image.shape[:2])

    @classmethod
    def file_of(cls, option: str, value: str) -> str | None:
        """The image."""
        return "image file" if option == "file" else None

    def open_files(self) -> None:
        """Reads the image, and checks that its projection is known."""
        _ = self._covered

    def image(self) -> Tensor:
        """The file's radiance (H, W, 3) as stored, times `scale`."""
        return torch.from_numpy(self._decoded.image)

    def cubemap(self) -> CubeMap:
        """The file's radiance as a cube map with the same energy."""
        with unchanged(locate(self.file)):  # its key reads the file again
            image, how = self.image(), self._covered
            return to_cubemap(image, how.projection, self.resolution, self.flip_vertical, self.key(), how.axes)

    def facts(self, cubemap: CubeMap | None = None) -> LightFacts:
        """Facts about the light, and how the file was read."""
        cubemap = self.cubemap() if cubemap is None else cubemap
        return collect_facts(cubemap, self._covered.projection, self.image(), self._covered.axes)

    def notes(self) -> tuple[str, ...]:
        """What was changed, left out or assumed when the file was read; each note begins with the file's name."""
        return tuple(f"{Path(self.file).name}: {note}" for note in self._decoded.notes + self._covered.notes)

    def key(self) -> str:
        """Hash of the file's bytes, and the options that say how to read it."""
        with locate(self.file).open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        reading = {k: v for k, v in self.as_dict().items() if k != "file"}
        return f"file:{digest}:{json.dumps(reading, sort_keys=True)}"


def resolve_light(text: str) -> tuple[str, dict[str, Any]]:
    """The light that one word means: a registered name, or the path of an image file with its option."""
    return ("file", {"file": text}) if Path(text).suffix and text not in LIGHTS.names() else (text, {})


def make_light(text: str, options: Mapping[str, Any]) -> Light:
    """The light of a registered name or of an image file, with options.

    Raises:
        InputError: a name or option is unknown, or a value is out of bounds.
    """
    name, stated = resolve_light(text)
    return LIGHTS.create(name, {**stated, **options})
