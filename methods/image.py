"""An image that another program rendered, as if it were the image of a method."""

import hashlib
import json
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Annotated

import torch
from pydantic import Field
from torch import Tensor

from glossbench.prefilter import (
    METHODS,
    Contract,
    Costs,
    ImageContent,
    InputError,
    Material,
    Method,
    Radiance,
    ShadingPoints,
    Timing,
    View,
    locate,
    read_file,
)


@METHODS.register("image")
class GivenImage(Method):
    """Lo = the pixel of an image file, which another program rendered with this light, material and view.

    So the image of any engine is compared by the same metrics and claims, and in the same viewer. Nothing is computed
    and nothing is timed: its costs are unknown, except for the shading time if it is stated. It cannot show that the
    other program had the same light, material, camera and units: an error of its set-up counts as an error of its
    method. One image belongs to one light, material and view; a study with more of them excludes the other cells.

    Attributes:
        file: path of the image, .exr, .hdr or .pfm; a relative one is searched in the current folder, the folder of the
            study and below GLOSSBENCH_DATA. It has the view's number of pixels, row 0 at the top, and holds linear
            radiance before exposure and tone curve. Pixels that do not show the surface do not count.
        layer: the layer or part that is the image, in an .exr with several.
        shade_seconds: shading time [s] on the machine that rendered it; by default unknown.

    Source: the file format, Kainz et al. 2004.
    """

    file: str
    layer: str | None = None
    shade_seconds: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None

    equation = 'L_o = "pixel of the file"'
    # It promises nothing: its pixels are those of one light, material and view.
    contract = Contract(furnace=float("inf"), linear=False, turns=float("inf"))

    @cached_property
    def _content(self) -> ImageContent:
        return read_file(locate(self.file), self.layer)

    @classmethod
    def file_of(cls, option: str, value: str) -> str | None:
        """The image."""
        return "image file" if option == "file" else None

    def open_files(self) -> None:
        """Reads the image."""
        _ = self._content

    def check_views(self, views: Sequence[View]) -> None:
        """Refuses more than one view, and an image of another size or with a pixel that is not finite."""
        if len(views) > 1:
            raise InputError(
                f"image.file {self.file!r} belongs to one light, material and view, but {len(views)} cells show it; "
                "leave the others out by exclude"
            )
        for view in views:
            self._read_pixels(view)

    def stated_costs(self) -> Costs:
        """The stated shading time, if any; nothing was timed."""
        seconds = float("nan") if self.shade_seconds is None else self.shade_seconds
        return Costs(shade=Timing(seconds, seconds, seconds), n_samples=1)

    def notes(self) -> tuple[str, ...]:
        """What was changed or assumed when the file was read; each note begins with the file's name."""
        return tuple(f"{Path(self.file).name}: {note}" for note in self._content.notes)

    def key(self) -> str:
        """Hash of the file's bytes, and the options that say how to read it."""
        with locate(self.file).open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        reading = {k: v for k, v in self.as_dict().items() if k != "file"}
        return f"image:{digest}:{json.dumps(reading, sort_keys=True)}"

    def shade(self, points: ShadingPoints, material: Material, view: View) -> Radiance:
        """The pixels of the view's mask (P, 3)."""
        return self._read_pixels(view).to(points.device)

    def _read_pixels(self, view: View) -> Tensor:
        """The pixels that show the surface (P, 3)."""
        image, mask = torch.from_numpy(self._content.image), view.mask()
        if image.shape[:2] != mask.shape:
            (height, width), (rows, columns) = image.shape[:2], mask.shape
            raise InputError(f"{self.file}: has {width} x {height} pixels, but the view has {columns} x {rows}")
        bad = mask & ~torch.isfinite(image).all(dim=2)
        if bad.any():
            row, column = bad.nonzero()[0].tolist()
            where = f"the first at row {row}, column {column}: {image[row, column].tolist()}"
            raise InputError(f"{self.file}: pixels must be finite, but {int(bad.sum())} are not, {where}")
        return image[mask]
