"""Filtered importance sampling, Krivanek and Colbert 2008: BRDF samples that read a filtered light."""

from math import log2
from typing import Annotated, Any, Literal

import torch
from pydantic import Field
from torch import Tensor

from glossbench.brdf.lobe import Lobe
from glossbench.brdf.material import Material
from glossbench.directions import PointSet, points_2d, to_world
from glossbench.envmap.pyramid import Environment, MipFilter, weighted_radiance
from glossbench.errors import InputError
from glossbench.fusion import over_points
from glossbench.options import Finite
from glossbench.scene.points import ShadingPoints
from glossbench.shading import METHODS, Contract, Method
from glossbench.stages import diffuse_radiance, irradiance, pyramid

LodBias = Literal["plain", "filament", "babylon", "materialx", "gltf_ibl_sampler"]
# Levels that each code adds to log4 of the exact ratio 1 / (N p Omega_texel), read from their sources: Filament and
# Babylon take K = 4, glTF-IBL-Sampler drops the 4 pi of the sphere.
LOD_BIAS: dict[LodBias, float] = {
    "plain": 0.0,
    "filament": 1.0,
    "babylon": 1.0,
    "materialx": 1.15,
    "gltf_ibl_sampler": 1.83,
}


@METHODS.register("filtered_importance_sampling")
class FilteredImportanceSampling(Method):
    """Lo ~ (1/N) sum of L(wi, l) f cos_i / p, l = max(1/2 log2(K / (N p Omega_texel)) + mip_bias, 0).

    wi is drawn by the BRDF's own sampler, the same N points at every pixel; l is the level of the pyramid whose texel
    covers the solid angle K / (N p) of a sample. Each glossy lobe is summed by itself with its share of the samples;
    the diffuse part is nine spherical harmonics. The filter is round: what an anisotropic lobe or a grazing view
    stretches, it blurs or misses.

    Attributes:
        samples: N, shared by the lobes.
        k: extent of the filter K; the paper chose 4 by eye, for a box pyramid.
        lod_bias: levels of a known code in place of 1/2 log2 K: plain 0, filament and babylon 1, materialx 1.15,
            gltf_ibl_sampler 1.83.
        mip_bias: levels added on top.
        mip_filter: of the pyramid.
        projection: of the light: the paper's dual paraboloid, or a cube with seamless edges.
        points: N points of the unit square.
        seed: of random points.

    Source: Krivanek and Colbert 2008, sections 4.2 and 5.1.
    """

    samples: Annotated[int, Field(ge=1, le=1 << 20)] = 40
    k: Annotated[float, Field(gt=0, le=1024)] = 4.0
    lod_bias: LodBias | None = None
    mip_bias: Annotated[Finite, Field(ge=-4, le=4)] = 0.0
    mip_filter: MipFilter = "box"
    projection: Literal["cube", "dual_paraboloid"] = "cube"
    points: PointSet = "hammersley"
    seed: int = 0

    # Measured: furnace 1.5e-4, slope -0.65.
    contract = Contract(furnace=1e-3, slope=-0.5)

    pyramid = pyramid
    irradiance = irradiance

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.lod_bias is not None and self.k != 4:
            raise InputError(
                f"filtered_importance_sampling.lod_bias replaces k, got both {self.lod_bias!r} and {self.k!r}"
            )

    def n_samples(self, material: Material) -> int:
        """Samples of all lobes: at least one each."""
        return sum(material.reflectance().share(self.samples))

    def shade(self, points: ShadingPoints, material: Material, pyramid: Environment, irradiance: Tensor) -> Tensor:
        """Radiance (P, 3)."""
        reflectance = material.reflectance(points.device)
        radiance = diffuse_radiance(reflectance, irradiance, points.n)
        for lobe, n in zip(reflectance.lobes, reflectance.share(self.samples), strict=True):
            samples = lobe.sample_points(points_2d(n, self.points, self.seed).to(points.device))
            extent = log2(self.k) / 2 if self.lod_bias is None else LOD_BIAS[self.lod_bias]
            level = torch.tensor(extent + self.mip_bias - log2(n) / 2, device=points.device)
            radiance += over_points(_kernel, points, n, lobe, samples, pyramid, level) / n
        return radiance


def _kernel(points: ShadingPoints, lobe: Lobe, samples: Any, pyramid: Environment, level: Tensor) -> Tensor:
    """Sum over samples of one lobe; level = log4(K / N) and the bias."""
    wi, pdf, weight = lobe.sample(points.wo_local(), samples)
    d = to_world(wi, points.t, points.b, points.n)
    lod = level + 0.5 * (pyramid.log2_texels_per_sr(d) - torch.log2(pdf))
    return weighted_radiance(pyramid, d, lod, weight)
