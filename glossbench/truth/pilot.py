"""A few points of a view from which the work of a reference is predicted."""

from dataclasses import dataclass

import torch
from torch import Tensor

from glossbench.brdf.material import Reflectance
from glossbench.directions import points_2d, to_world
from glossbench.envmap.cubemap import face_coordinates
from glossbench.scene.points import ShadingPoints
from glossbench.truth.blocks import LightBlocks

POINTS = 256
CANDIDATES = 32 * POINTS
SEEDS = 32  # samples of each lobe that say where it lies
SEED_SIZE = 4.0  # pdf times solid angle of a block about a sample
FINER = 2  # levels below it at which the light is read: a quarter of the lobe


@dataclass(frozen=True)
class Pilot:
    """Points, and how many points of the view each stands for, relative to their mean; None if all are alike.

    Attributes:
        share: (P,)
    """

    points: ShadingPoints
    share: Tensor | None = None

    def mean(self, values: Tensor) -> Tensor:
        """The mean over the view of values (..., P, C) at these points."""
        return values.mean() if self.share is None else (values * self.share[:, None]).mean()


def choose_pilot(points: ShadingPoints, reflectance: Reflectance, light: LightBlocks) -> Pilot:
    """Every n-th point; if a narrow lobe sees a small light at few of them, half are drawn by what they see.

    What a point sees is estimated by the means of the light in blocks about a few samples of each lobe. If the even
    points see another mean than many more candidates do, as under one lit texel, their errors say nothing about the
    view. Then candidates are drawn in proportion to a mixture of the even density and the estimate.
    """
    even, many = (points.map(lambda c: c[:: max(1, len(points) // n)]) for n in (POINTS, CANDIDATES))  # noqa: B023
    seen = estimate_radiance(many, reflectance, light)
    expected = seen.mean()
    if 0.7 * expected <= estimate_radiance(even, reflectance, light).mean() <= 1.4 * expected:
        return Pilot(even)
    density = 0.5 / len(many) + 0.5 * seen / seen.sum()
    places = (torch.arange(POINTS, device=points.device) + 0.5) / POINTS
    at = torch.searchsorted(density.cumsum(0), places.double()).clamp(max=len(many) - 1)
    return Pilot(many.map(lambda c: c[at]), 1 / (len(many) * density[at]))


def estimate_radiance(points: ShadingPoints, reflectance: Reflectance, light: LightBlocks) -> Tensor:
    """What glossy lobes show, roughly: a mean over samples of their weight times the light's mean about them, (P,)."""
    columns = points.columns(0, len(points))
    wo, total = columns.wo_local(), torch.zeros(len(points), dtype=torch.float64, device=points.device)
    for lobe in reflectance.lobes:
        wi, pdf, weight = lobe.sample(wo, lobe.sample_points(points_2d(SEEDS).to(points.device)))
        d = to_world(wi, columns.t, columns.b, columns.n)
        face, *place, major = face_coordinates(d)
        level = (seed_level(pdf, major) + FINER).clamp(0, len(light.tables) - 1).expand(face.shape)
        mean = torch.zeros(face.shape, dtype=torch.float64, device=points.device)
        for each in level.unique().tolist():
            n, chosen = 1 << each, level == each
            column, row = (((k[chosen] + 1) * (n / 2)).long().clamp(0, n - 1) for k in place)
            block = ((face[chosen].long() << each) + row << each) + column
            mean[chosen] = light.tables[each][block, 0].double().mean(1)
        strength = torch.stack(torch.broadcast_tensors(*weight)).double().mean(0)
        total += torch.where(wi.z > 0, strength * mean, 0.0).mean(1)
    return total


def seed_level(pdf: Tensor, major: Tensor) -> Tensor:
    """The level at which a block about a sample has the size of the lobe: pdf times its solid angle is SEED_SIZE."""
    return (1 + torch.log2(pdf * major**3 / SEED_SIZE).clamp(min=-2) / 2).ceil().long()
