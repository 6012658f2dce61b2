"""Glossy lobes: one summand of a BRDF with what evaluates it and what samples it.

Letters: wo to the viewer, wi to the light, h half vector, all unit and in the local frame, z along the normal;
c = wo . h; u uniform points of the unit square. What depends on the sample only has shape (1, N) and is computed
once (`sample_points`), what depends on the pixel has (P, 1), and the two meet in `sample`.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import torch

from glossbench.brdf.half_vector_pattern import HalfVectorPattern
from glossbench.channels import Channels, widen
from glossbench.directions import Vec3, points_2d
from glossbench.shapes import (
    Albedo,
    Directions,
    PairValues,
    PointDirections,
    Scalar,
    UnitSquare,
    Values,
)


class Sample(NamedTuple):
    """Light directions drawn by a lobe: weight = f cos_i / pdf a channel, zero where wi is not above the surface.

    pdf [1/sr] is positive and finite even where the weight is zero.
    """

    wi: Directions
    pdf: Values
    weight: Channels


@dataclass(frozen=True)
class Lobe(HalfVectorPattern):
    """A lobe with tensors for parameters.

    A model states `f_and_pdf`, `sample_points` and `sample`. A fixed pattern of half vectors lies over each lobe, too;
    a model whose density of half vectors is not Beckmann's states its own (see `HalfVectorPattern`).

    Attributes:
        widths: of D along t and b: Beckmann slopes m_x, m_y or GGX alpha_x, alpha_y.
        ks: factor of the whole lobe, a channel.
    """

    widths: tuple[Scalar, Scalar]
    ks: tuple[Scalar, ...]

    def f_and_pdf(self, wo: Directions, wi: Directions) -> tuple[tuple[PairValues, ...], PairValues]:
        """`f` and `pdf`, which share much."""
        raise NotImplementedError

    def f(self, wo: Directions, wi: Directions) -> tuple[PairValues, ...]:
        """Value [1/sr] a channel, the cosine not included; zero when a direction is below the surface."""
        return self.f_and_pdf(wo, wi)[0]

    def pdf(self, wo: Directions, wi: Directions) -> PairValues:
        """Density [1/sr] of `sample` at wi; zero below the surface, although samples fall there too."""
        return self.f_and_pdf(wo, wi)[1]

    def sample_points(self, u: UnitSquare) -> Any:
        """What of a sample depends on u only."""
        raise NotImplementedError

    def sample(self, wo: Directions, points: Any) -> Sample:
        """Light directions for these sample points."""
        raise NotImplementedError

    def albedo(self, wo: PointDirections, n_samples: int = 4096) -> Albedo:
        """Directional albedo: integral of f(wo, wi) cos_i dwi, RGB.

        By the lobe's own sampler at Hammersley points.
        """
        column = Vec3(*(c[:, None] for c in wo))
        weight = self.sample(column, self.sample_points(points_2d(n_samples).to(wo.z.device))).weight
        means = [w.expand(len(wo.z), n_samples).double().mean(1) for w in weight]
        return torch.stack(widen(tuple(means), 3), dim=1)
