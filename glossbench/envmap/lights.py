"""Lights: named options that become a cube map; here the abstract light and the light from an image file."""

import hashlib
import json
import os
from pathlib import Path
from typing import Annotated

from pydantic import Field

from glossbench.envmap.cubemap import CubeMap
from glossbench.envmap.files import read_image
from glossbench.envmap.projections import Projection, to_cubemap
from glossbench.errors import InputError
from glossbench.options import Options
from glossbench.registry import Registry

DATA_VARIABLE = "GLOSSBENCH_DATA"


class Light(Options):
    """Incoming radiance by name and options."""

    def cubemap(self) -> CubeMap:
        """The radiance itself."""
        raise NotImplementedError


LIGHTS: Registry[Light] = Registry("light", "glossbench.envmap", "glossbench.lights")


@LIGHTS.register("file")
class FileLight(Light):
    """Radiance of an HDR image file (.hdr, .exr).

    Attributes:
        file: path; a relative one is looked for here, beside the study and below the folder GLOSSBENCH_DATA.
        resolution: texels along the edge of a face, a power of two; by default what the image resolves.
        projection: how the image covers the sphere; by default recognised from its shape.
        flip_vertical: the image's first row is straight down.
    """

    file: str
    resolution: Annotated[int, Field(ge=2, le=8192)] | None = None
    projection: Projection | None = None
    flip_vertical: bool = False

    def cubemap(self) -> CubeMap:
        """The file's radiance as a cube map, its energy kept."""
        image = read_image(locate(self.file))
        return to_cubemap(image, self.projection, self.resolution, self.flip_vertical, key=self.key())

    def key(self) -> str:
        """Hash of the file's bytes, and the options that say how it is read."""
        digest = hashlib.sha256(locate(self.file).read_bytes()).hexdigest()
        reading = {k: v for k, v in self.as_dict().items() if k != "file"}
        return f"file:{digest}:{json.dumps(reading, sort_keys=True)}"


def locate(file: str, beside: Path | None = None) -> Path:
    """The existing file that a name means: as it stands, beside the study, or below GLOSSBENCH_DATA.

    Raises:
        InputError: no such file in any of these places.
    """
    folder = os.environ.get(DATA_VARIABLE)
    for place in [Path(file), *([beside / file] if beside else [])]:
        if place.is_file():
            return place
    if folder and Path(folder).is_dir() and not Path(file).is_absolute():
        found = sorted(Path(folder).rglob(Path(file).name))
        matching = [p for p in found if p.is_file() and p.as_posix().endswith(file)]
        if matching:
            return matching[0]
    where = f"not below {DATA_VARIABLE}={folder}" if folder else f"and {DATA_VARIABLE} names no folder of data"
    raise InputError(f"no image file {file!r}: not in {Path.cwd()} {where}")
