"""The lobe of a measured BRDF: values of a table, sampled by a density computed from the table."""

from dataclasses import dataclass
from functools import partial
from typing import Protocol

import torch

from glossbench.brdf.lobe import Lobe, Sample
from glossbench.brdf.measured.half_vector_density import HalfVectorDensity, TabulatedPoints, build_half_vector_density
from glossbench.channels import Channels, scalar, widen
from glossbench.directions import dot, half_vector, reflect
from glossbench.shapes import Choices, Directions, PairValues, UnitSquare


class Table(Protocol):
    """An isotropic BRDF as tabulated in a file; directions are above the surface."""

    def value(self, wo: Directions, wi: Directions) -> Channels:
        """f [1/sr] of red, green and blue, not negative; where nothing was measured, an extrapolated value or 0."""

    def known(self, wo: Directions, wi: Directions) -> Choices:
        """Whether f was measured there and is not extrapolated."""


@dataclass(frozen=True)
class MeasuredLobe(Lobe):
    """f = ks times the value of a table.

    `HalfVectorDensity` draws the half vectors, so the density of wi is p(h) / (4 c).

    Attributes:
        known_only: whether f is 0 where nothing was measured; otherwise it is the extrapolated value of the table.
    """

    table: Table
    known_only: bool
    density: HalfVectorDensity

    def f_and_pdf(self, wo: Directions, wi: Directions) -> tuple[tuple[PairValues, ...], PairValues]:
        """`f` and `pdf`."""
        h = half_vector(wo, wi)
        above = (wo.z > 0) & (wi.z > 0)
        pdf = torch.where(above, self.density.pdf(wo, h) / (4 * dot(wo, h)), 0.0)
        values = evaluate_table(self.table, self.known_only, wo, wi)
        return tuple(torch.where(above, ks * v, 0.0) for ks, v in zip(widen(self.ks, 3), values, strict=True)), pdf

    def sample_points(self, u: UnitSquare) -> TabulatedPoints:
        """Half vectors for each tabulated angle of the view."""
        return self.density.sample_points(u)

    def sample(self, wo: Directions, points: TabulatedPoints) -> Sample:
        """Mirror directions at the half vectors."""
        h, quarter_pdf = self.density.half_vectors(wo, points)
        c = dot(wo, h)
        wi = reflect(wo, h)
        visible = (wi.z > 0) & (c > 0)
        pdf = quarter_pdf / c.clamp(min=1e-4)
        weight = tuple(torch.where(visible, f * wi.z / pdf, 0.0) for f in self.f(wo, wi))
        return Sample(wi, pdf, weight)


def build_measured_lobe(table: Table, known_only: bool, device: str) -> MeasuredLobe:
    """The lobe of a table on a device; its widths are those of the density for a view along the normal."""
    density = build_half_vector_density(partial(evaluate_table, table, known_only), device)
    m = scalar(density.width(), device)
    return MeasuredLobe((m, m), (torch.ones((), device=device),), table, known_only, density)


def evaluate_table(table: Table, known_only: bool, wo: Directions, wi: Directions) -> Channels:
    """f of a table; with known_only it is 0 where nothing was measured."""
    values = table.value(wo, wi)
    if not known_only:
        return values
    known = table.known(wo, wi)
    return tuple(torch.where(known, value, 0.0) for value in values)
