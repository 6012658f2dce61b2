"""How an image covers the sphere: by the options, by its file, or by its shape."""

from typing import NamedTuple, cast

from glossbench.envmap.formats.image_content import Covering
from glossbench.envmap.projections.conversion import Projection, fits, guess_projection, note_unusual_shape


class CoveringChoice(NamedTuple):
    """The projection and the axes of an image, and notes about the choice."""

    projection: Projection
    axes: str
    notes: tuple[str, ...]


def resolve_covering(
    said: Covering | None, projection: Projection | None, axes: str | None, height: int, width: int
) -> CoveringChoice:
    """Options come first, then what the file states, then the shape and the axes `forward`.

    The axes that a file states belong to its projection: if the options state another projection, they are ignored.

    Raises:
        InputError: neither the options nor the file state a projection, and none has this shape.
    """
    notes = []
    if said is not None and not fits(said.projection, height, width):
        notes.append(f"{said.said_by} says {said.projection}, which does not fit {width} x {height} pixels: ignored")
        said = None
    if said is not None and projection not in (None, said.projection):
        notes.append(f"{said.said_by} says {said.projection}, but it is read as {projection}, as stated")
        said = None
    if said is None:
        chosen = projection or guess_projection(height, width)
        return CoveringChoice(chosen, axes or "forward", (*notes, *note_unusual_shape(chosen, height, width)))
    if axes not in (None, said.axes):
        notes.append(f"{said.said_by} says axes {said.axes}, but it is read with axes {axes}, as stated")
    elif axes is None and said.note:
        notes.append(said.note)
    notes += note_unusual_shape(said.projection, height, width)
    return CoveringChoice(cast("Projection", said.projection), axes or said.axes, tuple(notes))
