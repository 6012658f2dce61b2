"""Importance and environment sampling: right on average, for many seeds, within a confidence bound."""

from dataclasses import replace
from functools import cache

import pytest
import torch
from scipy.stats import t as student

from glossbench.brdf.ggx import GGX, TrowbridgeReitz
from glossbench.brdf.kurt import Kurt
from glossbench.brdf.microfacet import Beckmann
from glossbench.envmap.cubemap import CubeMap
from glossbench.envmap.lights.synthetic import Constant
from glossbench.methods import environment_sampling
from glossbench.methods.environment_sampling import EnvironmentSampling
from glossbench.methods.importance_sampling import ImportanceSampling
from glossbench.scene.sphere import Sphere
from glossbench.shading.image import shade
from glossbench.shading.stage_cache import StageCache
from glossbench.truth.reference import compute_reference

VIEW = Sphere(resolution=6)
CACHE = StageCache()
N_SEEDS, SAMPLES = 40, 2048
METHODS = {"importance_sampling": ImportanceSampling, "environment_sampling": EnvironmentSampling}
# Without a diffuse part: importance sampling adds that by nine spherical harmonics, which is not exact.
MATERIALS = {"kurt": Kurt(m=(0.4, 0.25), f0=(0.9, 0.5, 0.2)), "ggx": GGX(alpha=0.4)}


@cache
def light():
    generator = torch.Generator().manual_seed(5)
    return CubeMap(10 ** (1.5 * torch.rand(6, 8, 8, 3, generator=generator) - 1), "rough")


@cache
def truth(material):
    return compute_reference(light(), MATERIALS[material], VIEW, relative_error=3e-4, max_samples=1 << 18)


def worst_t(method, material):
    """Largest |mean over seeds - truth| over its standard error, of all pixels and channels."""
    right, cache = truth(material), StageCache()
    images = torch.stack(
        [
            shade(
                METHODS[method](samples=SAMPLES, points="random", seed=seed),
                light(),
                MATERIALS[material],
                VIEW,
                cache=cache,
                time_it=False,
            ).radiance[right.mask]
            for seed in range(N_SEEDS)
        ]
    ).double()
    variance = images.var(0) / N_SEEDS + right.standard_error[right.mask] ** 2
    return ((images.mean(0) - right.radiance[right.mask]).abs() / variance.sqrt()).max().item()


def t_limit():
    """Passed by 32 pixels, 3 channels and 4 tests together with 99 %: Student's t with 39 degrees of freedom."""
    return student.isf((1 - 0.99 ** (1 / (32 * 3 * 4))) / 2, N_SEEDS - 1)


@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("method", METHODS)
def test_mean_over_seeds_is_the_reference(method, material):
    assert worst_t(method, material) < t_limit()


def test_mean_over_seeds_notices_a_light_density_that_is_off_by_5_percent(monkeypatch):
    right = environment_sampling.luminance_distribution
    scaled = lambda light: replace(right(light), density=1.05 * right(light).density)  # noqa: E731
    monkeypatch.setattr(environment_sampling, "luminance_distribution", scaled)

    assert worst_t("environment_sampling", "ggx") > t_limit()


def test_mean_over_seeds_notices_a_sampler_with_swapped_widths(monkeypatch):
    right = Beckmann.sample_points
    swapped = lambda self, u: right(replace(self, widths=self.widths[::-1]), u)  # noqa: E731
    monkeypatch.setattr(Beckmann, "sample_points", swapped)

    assert worst_t("importance_sampling", "kurt") > t_limit()


def test_mean_over_seeds_notices_a_dropped_shadowing(monkeypatch):
    right = TrowbridgeReitz.sample

    def unshadowed(self, wo, points):
        sample = right(self, wo, points)
        return sample._replace(weight=tuple((w > 0) * F for w, F in zip(sample.weight, self.F(wo.z), strict=True)))

    monkeypatch.setattr(TrowbridgeReitz, "sample", unshadowed)

    assert worst_t("importance_sampling", "ggx") > t_limit()


# What either does at any budget.


@pytest.mark.parametrize("method", METHODS)
def test_same_seed_gives_the_same_image_and_another_seed_another(method):
    images = [
        shade(
            METHODS[method](samples=64, points="random", seed=seed),
            light(),
            MATERIALS["ggx"],
            VIEW,
            cache=CACHE,
            time_it=False,
        ).radiance
        for seed in (1, 1, 2)
    ]

    assert (images[0] == images[1]).all()
    assert (images[0] != images[2]).any()


@pytest.mark.parametrize(
    "material", [Kurt(m=0.3, kd=(0.5, 0.2, 0.1)), GGX(alpha=0.5, f0=0.04, kd=0.3)], ids=["kurt", "ggx"]
)
def test_importance_sampling_under_constant_light_returns_the_albedo_of_its_samples(material):
    image = shade(
        ImportanceSampling(samples=256),
        Constant(radiance=(1.0, 2.0, 0.5)).cubemap(),
        material,
        VIEW,
        cache=CACHE,
        time_it=False,
    )

    albedo = material.albedo(VIEW.points().wo_local(), n_samples=256) * torch.tensor([1.0, 2.0, 0.5])
    torch.testing.assert_close(image.radiance[image.mask].double(), albedo, rtol=1e-5, atol=0)


def test_environment_sampling_converges_under_constant_light():
    material = Kurt(m=0.5, kd=0.3)
    albedo = material.albedo(VIEW.points().wo_local())

    image = shade(
        EnvironmentSampling(samples=1 << 14), Constant().cubemap(), material, VIEW, cache=CACHE, time_it=False
    )

    error = (image.radiance[image.mask] - albedo).square().mean().sqrt() / albedo.mean()
    # Measured: 6.3e-4, and 0.021 with 256 lights.
    assert error < 1.5e-3


def test_lobes_share_the_budget_and_add_up():
    lobes = ({"m": (0.1, 0.1), "ks": 0.75}, {"m": (0.3, 0.2), "ks": 0.25, "f0": 0.5})

    def radiance(material, samples):
        return shade(ImportanceSampling(samples=samples), light(), material, VIEW, cache=CACHE, time_it=False).radiance

    together = radiance(Kurt(lobes=lobes), 32)

    apart = radiance(Kurt(**lobes[0]), 24) + radiance(Kurt(**lobes[1]), 8)
    torch.testing.assert_close(together, apart, rtol=1e-5, atol=1e-7)
