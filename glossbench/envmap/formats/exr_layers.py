"""Layers of an OpenEXR image: finds the channels and the part that hold its colour."""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import OpenImageIO as oiio

from glossbench.errors import InputError, suggest_nearest

# Names that programs give to the layer of all light, the surest first; a layer without a name is the surest.
_COMBINED = ("", "combined", "rgba", "rgb", "beauty", "c", "ci", "color", "colour", "main", "final", "image", "default")
_LEAVES = {"r": 0, "red": 0, "g": 1, "green": 1, "b": 2, "blue": 2}
_GREY = ("y", "l", "luminance", "grey", "gray")
_IDS = re.compile(r"crypto\w*\d\d$", re.IGNORECASE)  # Cryptomatte: R, G, B, A are names of objects and shares
_LISTED = 12  # largest number of channels or layers that a message names


class Layer(NamedTuple):
    """Channels that form one colour.

    Attributes:
        part: number of the part.
        channels: numbers of the channels red, green and blue, or three times that of the luminance.
        alpha: number of the alpha channel, or None.
        names: names by which a user can choose it, the longest first.
        view: view of a stereo image, e.g. left; "" if there are no views.
        plain: name without the view, in lower case; "" if it needs no name.
    """

    part: int
    channels: tuple[int, int, int]
    alpha: int | None
    names: tuple[str, ...]
    view: str
    plain: str


def choose_layer(path: Path, parts: Sequence[oiio.ImageSpec], wanted: str | None) -> tuple[Layer, tuple[str, ...]]:
    """The wanted layer, by default the one that holds all of the light, and notes about the choice.

    A layer is R, G, B (also r, g, b or red, green, blue) with one prefix or in one part; if there is none, a luminance
    Y. If there are several layers, all of the light is in the one without a name, else in the combined one (Combined,
    RGBA, beauty, ...). In a stereo image it is the layer of the first view.

    Raises:
        InputError: the layer does not exist, no layer is a colour, or there are several and none is the combined one.
    """
    layers = _find_layers(parts)
    if wanted is not None:
        named = [layer for layer in layers if wanted in layer.names]
        if not named:
            known = {name for layer in layers for name in layer.names if name}
            raise InputError(f"{path}: has no layer {wanted!r} with R, G, B{suggest_nearest(wanted, known)}")
        if len(named) > 1:
            raise InputError(f"{path}: layer {wanted!r} is in several parts: {_join_names(x.names[0] for x in named)}")
        return named[0], ()
    if not layers:
        raise InputError(f"{path}: {_explain_missing_colour([name for spec in parts for name in spec.channelnames])}")
    first = next(iter(_find_views(parts[layers[0].part])), layers[0].view)
    seen = [layer for layer in layers if layer.view == first] or layers
    ranked = [layer for layer in seen if layer.plain in _COMBINED]
    best = min((_COMBINED.index(layer.plain) for layer in ranked), default=0)
    chosen = [layer for layer in ranked if _COMBINED.index(layer.plain) == best] or seen
    if len(chosen) > 1:
        names = _join_names(layer.names[0] for layer in layers)
        raise InputError(f"{path}: has several layers, none of which is the combined one; name one by layer: {names}")
    notes = []
    if len(seen) < len(layers):
        notes.append(f"the view {seen[0].view} is read, one of {_join_names(dict.fromkeys(x.view for x in layers))}")
    if len(seen) > 1 and chosen[0].plain:
        notes.append(
            f"the layer {chosen[0].names[0]} is read, one of {_join_names(x.names[0] or 'R, G, B' for x in seen)}"
        )
    elif not ranked and chosen[0].names[0]:
        notes.append(f"the layer {chosen[0].names[0]} is read, because only this one has colour")
    return chosen[0], tuple(notes)


def _find_layers(parts: Sequence[oiio.ImageSpec]) -> list[Layer]:
    """All layers of colour; if there are none, those of luminance."""
    colour: list[Layer] = []
    grey: list[Layer] = []
    for part, spec in enumerate(parts):
        title = spec.get_string_attribute("name") if len(parts) > 1 else ""
        found: dict[str, dict[str, int]] = {}
        for channel, name in enumerate(spec.channelnames):
            prefix, _, leaf = name.rpartition(".")
            found.setdefault(prefix, {}).setdefault(leaf.lower(), channel)
        for prefix, leaves in found.items():
            if _IDS.search(prefix or title):
                continue
            at = {_LEAVES[leaf]: channel for leaf, channel in leaves.items() if leaf in _LEAVES}
            if len(at) == 3:
                colour.append(_make_layer(spec, title, prefix, part, (at[0], at[1], at[2]), leaves))
            # X, Y, Z is a position or a normal; Y, RY, BY is luminance with chroma.
            elif not at and not {"x", "ry", "by"} & set(leaves):
                channels = [channel for leaf, channel in leaves.items() if leaf in _GREY]
                if len(channels) == 1:
                    grey.append(_make_layer(spec, title, prefix, part, (channels[0],) * 3, leaves))
    found_layers = colour or grey
    # If only one part holds unnamed colour, its title does not matter: it is the picture.
    bare = [layer for layer in found_layers if "" in layer.names]
    alone = len({layer.part for layer in bare}) == 1
    return [layer._replace(plain="") if alone and layer in bare else layer for layer in found_layers]


def _make_layer(
    spec: oiio.ImageSpec, title: str, prefix: str, part: int, channels: tuple[int, int, int], leaves: dict[str, int]
) -> Layer:
    views = _find_views(spec)
    words = (prefix or title).split(".")
    # Channels of the first view do not carry its name.
    view = spec.get_string_attribute("view") or next((word for word in reversed(words) if word in views), "")
    plain = ".".join(word for word in words if word != view) if view else prefix or title
    full = f"{title}.{prefix}" if title and prefix else prefix or title
    names = dict.fromkeys([full, prefix, *([title] if not prefix else [])])
    alpha = leaves.get("a", leaves.get("alpha"))
    return Layer(part, channels, alpha, tuple(names), view or next(iter(views), ""), plain.rpartition(".")[2].lower())


def _find_views(spec: oiio.ImageSpec) -> list[str]:
    """The views of a stereo image in one part; channels without the name of a view belong to the first."""
    stated = spec.getattribute("multiView")
    return [stated] if isinstance(stated, str) else list(stated or ())


def _explain_missing_colour(channels: list[str]) -> str:
    leaves = {name.rpartition(".")[2].lower() for name in channels}
    if {"ry", "by"} & leaves:
        return "holds luminance and chroma (Y, RY, BY), not R, G, B; convert it first"
    return f"holds no colour: a light needs channels R, G, B or Y, its channels are {_join_names(channels)}"


def _join_names(names: Iterable[str]) -> str:
    every = list(names)
    more = f" and {len(every) - _LISTED} more" if len(every) > _LISTED else ""
    return ", ".join(every[:_LISTED]) + more
