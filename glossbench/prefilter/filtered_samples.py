"""Samples of a lobe that read a filtered light: the direction and the level of each."""

from typing import Any, NamedTuple

import torch
from torch import Tensor

from glossbench.brdf.lobe import Lobe
from glossbench.channels import Channels
from glossbench.directions import Vec3, to_world
from glossbench.envmap.pyramid import Environment
from glossbench.scene.points import ShadingPoints


class FilteredSamples(NamedTuple):
    """Samples of one lobe at points, components (P, N).

    Attributes:
        wi: directions to the light in the local frame.
        d: the same directions in the axes of the world.
        lod: the levels of the light to read.
        weight: f cos_i / pdf, by channel.
    """

    wi: Vec3
    d: Vec3
    lod: Tensor
    weight: Channels


def filtered_samples(
    points: ShadingPoints, lobe: Lobe, samples: Any, environment: Environment, level: Tensor
) -> FilteredSamples:
    """The samples of a lobe, each at the level whose texel covers a given share of 1 / pdf.

    lod = level + log4(texels per sr / pdf)

    Args:
        points: components (P, 1).
        samples: the sample points of the lobe.
        level: log4 of the share, plus a bias if there is one.

    Source: Krivanek and Colbert 2008, section 3.
    """
    wi, pdf, weight = lobe.sample(points.wo_local(), samples)
    d = to_world(wi, points.t, points.b, points.n)
    lod = level + 0.5 * (environment.log2_texels_per_sr(d) - torch.log2(pdf))
    return FilteredSamples(wi, d, lod, weight)
