"""The light of an image file, and what one word means as a light."""

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
from glossbench.envmap.formats.decoded import Decoded
from glossbench.envmap.formats.files import read_file
from glossbench.envmap.formats.radiance import Invalid, fit_to_be_light
from glossbench.envmap.lights.facts import LightFacts, facts
from glossbench.envmap.lights.light import LIGHTS, Light
from glossbench.envmap.projections.axes import Axes
from glossbench.envmap.projections.conversion import Projection, to_cubemap
from glossbench.envmap.projections.covering import Covered, covered
from glossbench.options import Resolution
from glossbench.unchanged import unchanged


@LIGHTS.register("file")
class FileLight(Light):
    """Radiance of an image file: .exr, .hdr, .tif, .pfm or .dds, or one of integers where `ldr` says so.

    Attributes:
        file: path of the image; a relative one is looked for here, beside the study and below GLOSSBENCH_DATA.
        resolution: texels along the edge of a face, a power of two; by default what the image resolves.
        projection: how the image covers the sphere; by default what the file says, else recognised from its shape.
        axes: whose axis convention it follows; by default what the file says, else forward (-z) is in the centre (see
            the module axes).
        flip_vertical: the image's first row is straight down.
        scale: factor on the radiance.
        layer: of an .exr with several, the layer or part that is the light.
        ldr: take a .png, .jpg or .tif of 8 or 16 bits, decoded from sRGB, for what it is worth.
        invalid: refuse an image with a value that is NaN, infinite, above 1e30 or negative, or clamp: what is too large
            becomes the largest of the other values, what is negative or NaN becomes 0, and a note says how many.
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
    def _decoded(self) -> Decoded:
        """The content of the file, of which all below is made."""
        path = locate(self.file)
        decoded = read_file(path, self.layer, self.ldr)
        if self.scale != 1:
            decoded.image[...] *= np.float32(self.scale)
        return decoded._replace(notes=decoded.notes + fit_to_be_light(path, decoded.image, self.invalid))

    @cached_property
    def _covered(self) -> Covered:
        """How the image covers the sphere."""
        return covered(self._decoded.covers, self.projection, self.axes, *self._decoded.image.shape[:2])

    @classmethod
    def file_of(cls, option: str, value: str) -> str | None:
        """The image."""
        return "image file" if option == "file" else None

    def open_files(self) -> None:
        """The image, and whether its shape says how it covers the sphere."""
        _ = self._covered

    def image(self) -> Tensor:
        """The file's radiance (H, W, 3) as stored, times `scale`."""
        return torch.from_numpy(self._decoded.image)

    def cubemap(self) -> CubeMap:
        """The file's radiance as a cube map, its energy kept."""
        with unchanged(locate(self.file)):  # its key reads the file again
            image, how = self.image(), self._covered
            return to_cubemap(image, how.projection, self.resolution, self.flip_vertical, self.key(), how.axes)

    def facts(self, cubemap: CubeMap | None = None) -> LightFacts:
        """What the file holds, and how it was understood."""
        cubemap = self.cubemap() if cubemap is None else cubemap
        return facts(cubemap, self._covered.projection, self.image(), self._covered.axes)

    def notes(self) -> tuple[str, ...]:
        """What was changed, left out or assumed of the file's content, each with the file's name."""
        return tuple(f"{Path(self.file).name}: {note}" for note in self._decoded.notes + self._covered.notes)

    def key(self) -> str:
        """Hash of the file's bytes, and the options that say how it is read."""
        with locate(self.file).open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        reading = {k: v for k, v in self.as_dict().items() if k != "file"}
        return f"file:{digest}:{json.dumps(reading, sort_keys=True)}"


def file_or_name(text: str) -> tuple[str, dict[str, Any]]:
    """What one word means as a light: a registered name, or an image file, with the options that this states."""
    return ("file", {"file": text}) if Path(text).suffix and text not in LIGHTS.names() else (text, {})


def light_named(text: str, options: Mapping[str, Any]) -> Light:
    """The light of a registered name or of an image file, with options.

    Raises:
        InputError: unknown name or option, or a value out of bounds.
    """
    name, stated = file_or_name(text)
    return LIGHTS.create(name, {**stated, **options})
