"""Visibility by shadow rays: which samples of a light the scene hides, and the diffuse part that is left of it."""

from typing import Any

import torch

from glossbench.channels import Channels
from glossbench.directions import Vec3
from glossbench.scene.points import Occluder, ShadingPoints
from glossbench.shading.kernels import untraced
from glossbench.shapes import Directions


def occluder_of(scene: Any) -> Occluder | None:
    """The scene where it hides light, else None."""
    return scene if isinstance(scene, Occluder) else None


def unhidden(weight: Channels, points: ShadingPoints, d: Directions, occluder: Occluder | None) -> Channels:
    """The weights, zero where the scene hides the direction d; None hides nothing.

    Only of what has a weight a ray is cast. d is in the world's axes.
    """
    return weight if occluder is None else _cast(weight, points, d, occluder)


@untraced
def _cast(weight: Channels, points: ShadingPoints, d: Directions, occluder: Occluder) -> Channels:
    assert points.position is not None
    assert points.ng is not None
    seen = torch.stack(torch.broadcast_tensors(*weight, d.x)[:-1]).amax(0) > 0
    rows, columns = seen.nonzero(as_tuple=True)
    position, ng = (Vec3(*(c[rows, 0] for c in v)) for v in (points.position, points.ng))
    seen[rows, columns] = occluder.visible(position, ng, Vec3(*(c.expand_as(seen)[rows, columns] for c in d)))
    return tuple(channel * seen for channel in weight)
