"""Visibility by shadow rays: the samples of a light that the scene hides get the weight zero."""

from typing import Any

import torch

from glossbench.channels import Channels
from glossbench.directions import Vec3
from glossbench.scene.points import Occluder, ShadingPoints
from glossbench.shading.kernels import untraced
from glossbench.shapes import Directions


def occluder_of(scene: Any) -> Occluder | None:
    """The scene if it can hide light, otherwise None."""
    return scene if isinstance(scene, Occluder) else None


def unhidden(weight: Channels, points: ShadingPoints, d: Directions, occluder: Occluder | None) -> Channels:
    """The weights, set to zero where the scene hides the direction d; without an occluder they do not change.

    Rays are cast only for samples with a weight above zero. d is in the axes of the world.
    """
    return weight if occluder is None else _cast_rays(weight, points, d, occluder)


@untraced
def _cast_rays(weight: Channels, points: ShadingPoints, d: Directions, occluder: Occluder) -> Channels:
    assert points.position is not None
    assert points.ng is not None
    seen = torch.stack(torch.broadcast_tensors(*weight, d.x)[:-1]).amax(0) > 0
    rows, columns = seen.nonzero(as_tuple=True)
    position, ng = (Vec3(*(c[rows, 0] for c in v)) for v in (points.position, points.ng))
    seen[rows, columns] = occluder.visible(position, ng, Vec3(*(c.expand_as(seen)[rows, columns] for c in d)))
    return tuple(channel * seen for channel in weight)
