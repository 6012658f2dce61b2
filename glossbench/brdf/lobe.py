"""Glossy lobes: one summand of a BRDF, its evaluation and its sampling.

Letters: wo to the viewer, wi to the light, h half vector, all unit and in the local frame, z along the normal;
c = wo . h; u uniform points of the unit square. Values that depend only on the sample have shape (1, N) and are
computed once (`sample_points`); values that depend on the pixel have shape (P, 1); `sample` combines both.
"""

from dataclasses import dataclass
from typing import Any, ClassVar, Literal, NamedTuple

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

# How a lobe draws its half vectors: as its model usually does, with density D cos_h, or by what wo sees (GGX).
Sampler = Literal["own", "normals", "visible_normals", "spherical_caps", "bounded_caps"]


class Sample(NamedTuple):
    """Light directions drawn by a lobe: weight = f cos_i / pdf per channel, zero if wi is not above the surface.

    pdf [1/sr] is positive and finite even where the weight is zero.
    """

    wi: Directions
    pdf: Values
    weight: Channels


@dataclass(frozen=True)
class Lobe(HalfVectorPattern):
    """A lobe whose parameters are tensors.

    A model defines `f_and_pdf`, `sample_points` and `sample`. Each lobe also has a fixed pattern of half vectors; a
    model whose density of half vectors is not Beckmann's defines its own (see `HalfVectorPattern`).

    Attributes:
        widths: widths of D along t and b: Beckmann slopes m_x, m_y or GGX alpha_x, alpha_y.
        ks: factor of the whole lobe per channel.
        samplers: the samplers that it has.
    """

    widths: tuple[Scalar, Scalar]
    ks: tuple[Scalar, ...]
    samplers: ClassVar[tuple[Sampler, ...]] = ("own",)

    def f_and_pdf(self, wo: Directions, wi: Directions) -> tuple[tuple[PairValues, ...], PairValues]:
        """`f` and `pdf` together, because they share most of the work."""
        raise NotImplementedError

    def f(self, wo: Directions, wi: Directions) -> tuple[PairValues, ...]:
        """Value [1/sr] per channel, without the cosine; zero if a direction is below the surface."""
        return self.f_and_pdf(wo, wi)[0]

    def pdf(self, wo: Directions, wi: Directions) -> PairValues:
        """Density [1/sr] of `sample` at wi; zero below the surface, although some samples fall there."""
        return self.f_and_pdf(wo, wi)[1]

    def sample_points(self, u: UnitSquare) -> Any:
        """The part of a sample that depends only on u."""
        raise NotImplementedError

    def sample(self, wo: Directions, points: Any) -> Sample:
        """Light directions for these sample points."""
        raise NotImplementedError

    def sampled_by(self, sampler: Sampler) -> "Lobe":
        """This lobe with one of its samplers."""
        return self

    def albedo(self, wo: PointDirections, n_samples: int = 4096) -> Albedo:
        """Directional albedo: integral of f(wo, wi) cos_i dwi, RGB.

        Computed by the lobe's own sampler at Hammersley points.
        """
        column = Vec3(*(c[:, None] for c in wo))
        weight = self.sample(column, self.sample_points(points_2d(n_samples).to(wo.z.device))).weight
        means = [w.expand(len(wo.z), n_samples).double().mean(1) for w in weight]
        return torch.stack(widen(tuple(means), 3), dim=1)
