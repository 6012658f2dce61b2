"""Materials: reflectance models by name and options, made of a diffuse part and any number of glossy lobes."""

from dataclasses import dataclass
from math import pi

import torch

from glossbench.brdf.lobe import Lobe, Sampler
from glossbench.catalog.naming import explain_catalog_name
from glossbench.channels import Channels, add
from glossbench.options import Options
from glossbench.registry import Registry
from glossbench.shapes import Albedo, Directions, PairValues, PointDirections, Scalar

MAX_LOBES = 16  # per material: the reference has a kernel for each lobe


@dataclass(frozen=True)
class Reflectance:
    """The parts of a material as tensors: f(wo, wi) = diffuse / pi + sum of lobe.f(wo, wi).

    Attributes:
        diffuse: diffuse albedo per channel, one channel for a grey material, else three; empty without diffuse part.
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
        # Rounding down leaves some samples over: they go to the largest remainders.
        order = sorted(range(len(parts)), key=lambda i: counts[i] - parts[i])
        for i in order[: max(0, samples - sum(counts))]:
            counts[i] += 1
        # Weak lobes were given one sample at least: the largest count pays for it.
        while sum(counts) > max(samples, len(counts)):
            counts[counts.index(max(counts))] -= 1
        return counts

    def sampled_by(self, sampler: Sampler) -> "Reflectance":
        """The same parts, each lobe with this sampler, which `explain_sampler` must not refuse."""
        return Reflectance(self.diffuse, tuple(lobe.sampled_by(sampler) for lobe in self.lobes))

    def explain_sampler(self, sampler: Sampler) -> str | None:
        """The reason why a lobe cannot be sampled in this way; None if all can."""
        for lobe in self.lobes:
            if sampler not in lobe.samplers:
                return f"a lobe of the material has no sampler {sampler!r}, it has {', '.join(lobe.samplers)}"
        return None

    def diffuse_f(self) -> Channels:
        """The diffuse part of f above the surface, albedo / pi [1/sr] per channel."""
        return tuple(d / pi for d in self.diffuse)

    def f(self, wo: Directions, wi: Directions) -> tuple[PairValues, ...]:
        """BRDF value [1/sr] per channel, without the cosine; zero if a direction is below the surface."""
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
        """The lobes that methods draw samples from: those of the material itself, or a fit if it is measured."""
        return self.reflectance(device)

    def f(self, wo: Directions, wi: Directions) -> tuple[PairValues, ...]:
        """BRDF value [1/sr] per channel, without the cosine; zero if a direction is below the surface."""
        return self.reflectance().f(wo, wi)

    def albedo(self, wo: PointDirections, n_samples: int = 4096) -> Albedo:
        """Directional albedo: integral of f(wo, wi) cos_i dwi, RGB.

        Each lobe is integrated by its own sampler at Hammersley points; the diffuse part is exact.
        """
        reflectance = self.reflectance()
        total = torch.zeros(wo.z.shape[0], 3, dtype=torch.float64)
        if reflectance.diffuse:
            total += torch.stack(reflectance.diffuse).double()
        for lobe in reflectance.lobes:
            total += lobe.albedo(wo, n_samples)
        return total


MATERIALS: Registry[Material] = Registry("material", "glossbench.brdf", "glossbench.brdfs", explain_catalog_name)
