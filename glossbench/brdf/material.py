"""Materials: a diffuse part and any number of glossy lobes; reflectance models by name and options."""

from dataclasses import dataclass
from math import pi

import torch

from glossbench.brdf.lobe import Lobe
from glossbench.catalog.naming import kind_in_catalog
from glossbench.channels import Channels, add
from glossbench.options import Options
from glossbench.registry import Registry
from glossbench.shapes import Albedo, Directions, PairValues, PointDirections, Scalar

MAX_LOBES = 16  # of a material: as many kernels as the reference has


@dataclass(frozen=True)
class Reflectance:
    """What a material is made of, as tensors: f(wo, wi) = diffuse / pi + sum of lobe.f(wo, wi).

    Attributes:
        diffuse: diffuse albedo a channel (one channel when the material is grey, else three); empty for none.
        lobes: the glossy lobes, strongest first or in the author's order.
    """

    diffuse: tuple[Scalar, ...]
    lobes: tuple[Lobe, ...]

    def share(self, samples: int) -> list[int]:
        """A budget of samples divided among the lobes in proportion to ks; each gets at least one."""
        strength = [float(torch.stack(lobe.ks).mean()) for lobe in self.lobes]
        total = sum(strength)
        parts = [samples * (s / total if total > 0 else 1 / len(strength)) for s in strength]
        counts = [max(1, int(part)) for part in parts]
        # What rounding down left goes to the largest remainders.
        order = sorted(range(len(parts)), key=lambda i: counts[i] - parts[i])
        for i in order[: max(0, samples - sum(counts))]:
            counts[i] += 1
        # What the ones of weak lobes took is the largest's.
        while sum(counts) > max(samples, len(counts)):
            counts[counts.index(max(counts))] -= 1
        return counts

    def diffuse_f(self) -> Channels:
        """The diffuse part of f above the surface, albedo / pi [1/sr] a channel."""
        return tuple(d / pi for d in self.diffuse)

    def f(self, wo: Directions, wi: Directions) -> tuple[PairValues, ...]:
        """BRDF value [1/sr] a channel, the cosine not included; zero when a direction is below the surface."""
        above = (wo.z > 0) & (wi.z > 0)
        total: Channels = tuple(torch.where(above, f, 0.0) for f in self.diffuse_f())
        for lobe in self.lobes:
            total = add(total, lobe.f(wo, wi))
        return total


class Material(Options):
    """A reflectance model by name and options, in the local frame (t, b, n)."""

    def reflectance(self, device: str = "cpu") -> Reflectance:
        """The model as tensors on a device."""
        raise NotImplementedError

    def as_lobes(self, device: str = "cpu") -> Reflectance:
        """What methods that draw samples take: the material itself, but for a measured one, which is fitted."""
        return self.reflectance(device)

    def f(self, wo: Directions, wi: Directions) -> tuple[PairValues, ...]:
        """BRDF value [1/sr] a channel, the cosine not included; zero when a direction is below the surface."""
        return self.reflectance().f(wo, wi)

    def albedo(self, wo: PointDirections, n_samples: int = 4096) -> Albedo:
        """Directional albedo: integral of f(wo, wi) cos_i dwi, RGB.

        Each lobe is summed by its own sampler at Hammersley points, the diffuse part is exact.
        """
        reflectance = self.reflectance()
        total = torch.zeros(wo.z.shape[0], 3, dtype=torch.float64)
        if reflectance.diffuse:
            total += torch.stack(reflectance.diffuse).double()
        for lobe in reflectance.lobes:
            total += lobe.albedo(wo, n_samples)
        return total


MATERIALS: Registry[Material] = Registry("material", "glossbench.brdf", "glossbench.brdfs", kind_in_catalog)
