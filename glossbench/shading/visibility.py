"""Visibility by shadow rays: the samples of a light that the scene hides get the weight zero.

A library casts the rays, so a compiled kernel has two parts. The first ends where the kernel asks which samples are
hidden; then the rays are cast; the second part runs the kernel with the answer.
"""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import torch
from torch import Tensor

from glossbench.channels import Channels
from glossbench.directions import Vec3
from glossbench.scene.points import Occluder, ShadingPoints
from glossbench.shapes import Directions


class Question(NamedTuple):
    """Which of P x N samples need a ray, and their directions, components (P, N), in the axes of the world."""

    needed: Tensor
    direction: Vec3


@dataclass(frozen=True)
class Asked(Occluder):
    """Stands for the scene in the first part of a compiled kernel, and keeps what the kernel asks."""

    questions: list[Question] = field(default_factory=list)


@dataclass(frozen=True)
class Answered(Occluder):
    """Stands for the scene in the second part of a compiled kernel: which samples see the light, (P, N)."""

    seen: Tensor


def occluder_of(scene: Any) -> Occluder | None:
    """The scene if it can hide light, otherwise None."""
    return scene if isinstance(scene, Occluder) else None


def unhidden(weight: Channels, points: ShadingPoints, d: Directions, occluder: Occluder | None) -> Channels:
    """The weights, set to zero where the scene hides the direction d; without an occluder they do not change.

    Rays are cast only for samples with a weight above zero. d is in the axes of the world.
    """
    if occluder is None:
        return weight
    if isinstance(occluder, Answered):
        return tuple(channel * occluder.seen for channel in weight)
    needed = torch.stack(torch.broadcast_tensors(*weight, d.x)[:-1]).amax(0) > 0
    question = Question(needed, Vec3(*(c.expand_as(needed) for c in d)))
    if isinstance(occluder, Asked):
        occluder.questions.append(question)
        return weight
    seen = answer(question, points, occluder)
    return tuple(channel * seen for channel in weight)


def answer(question: Question, points: ShadingPoints, occluder: Occluder) -> Tensor:
    """Whether each sample sees the light, (P, N); false where no ray is needed."""
    assert points.position is not None
    assert points.ng is not None
    seen = question.needed.clone()
    rows, columns = seen.nonzero(as_tuple=True)
    position, ng = (Vec3(*(c[rows, 0] for c in v)) for v in (points.position, points.ng))
    seen[rows, columns] = occluder.visible(position, ng, Vec3(*(c[rows, columns] for c in question.direction)))
    return seen
