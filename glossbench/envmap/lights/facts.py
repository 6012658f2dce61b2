"""Facts about a light: a dozen numbers that describe it."""

from dataclasses import dataclass
from math import pi

import torch
from torch import Tensor

from glossbench.channels import LUMINANCE
from glossbench.directions import vec3
from glossbench.envmap.cubemap import CubeMap, texel_solid_angles

Color = tuple[float, float, float]


@dataclass(frozen=True)
class LightFacts:
    """Facts about a light; means, shares and percentiles are over the sphere, by exact solid angle.

    Luminance is that of linear Rec. 709, 0.2126 R + 0.7152 G + 0.0722 B. All facts but those of the image are about the
    cube map, after resampling.

    Attributes:
        resolution: texels along the edge of a face.
        mean: mean radiance, RGB.
        peak: largest luminance.
        dynamic_range: peak / first percentile of the luminance, over the part of the sphere that is not black; 1 for a
            black light.
        brightest_share: share of the total luminance in the brightest 0.1 % of the sphere, [0, 1]; 0 for a black light.
        irradiance_up, irradiance_right, irradiance_forward: integral of L cos about +y, +x, -z, RGB.
        projection, axes: those of the image that the light comes from; None if it does not come from an image.
        width, height: size of this image [pixels].
        image_peak: largest luminance of its pixels; `peak` is lower if a lamp is smaller than a texel.
    """

    resolution: int
    mean: Color
    peak: float
    dynamic_range: float
    brightest_share: float
    irradiance_up: Color
    irradiance_right: Color
    irradiance_forward: Color
    projection: str | None = None
    axes: str | None = None
    width: int | None = None
    height: int | None = None
    image_peak: float | None = None


def collect_facts(
    cubemap: CubeMap, projection: str | None = None, image: Tensor | None = None, axes: str | None = None
) -> LightFacts:
    """Facts about a cube map and, if it comes from an image (H, W, 3), about this image."""
    resolution = cubemap.resolution
    # Single precision, and arrays are reused: a cube map with 2048 texels along an edge needs gigabytes.
    luminance, order = torch.cat([_luminance(face) for face in cubemap.faces.cpu()]).sort(descending=True)
    share = texel_solid_angles(resolution).flatten()[order.remainder_(resolution**2)]
    del order
    area, flux, peak = share.cumsum(0), share.mul_(luminance).cumsum_(0), luminance[0].item()
    n_lit = int((luminance > 0).sum())
    dim = _find_at(area[:n_lit], luminance[:n_lit], 0.99 * area[n_lit - 1].item()) if peak > 0 else 1.0
    e = cubemap.irradiance(vec3(torch.tensor([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]))).tolist()
    return LightFacts(
        resolution=resolution,
        mean=tuple(cubemap.mean().tolist()),
        peak=peak,
        dynamic_range=peak / dim if peak > 0 else 1.0,
        brightest_share=_interpolate(area, flux, 0.001 * 4 * pi) / flux[-1].item() if peak > 0 else 0.0,
        irradiance_up=tuple(e[0]),
        irradiance_right=tuple(e[1]),
        irradiance_forward=tuple(e[2]),
        projection=projection,
        axes=axes,
        width=None if image is None else image.shape[1],
        height=None if image is None else image.shape[0],
        image_peak=None if image is None else max(_luminance(rows).max().item() for rows in image.split(256)),
    )


def _luminance(image: Tensor) -> Tensor:
    """Luminance (N,) of pixels (..., 3), rounded to float32."""
    return (image.double() @ torch.tensor(LUMINANCE).double()).float().flatten()


def _find_at(x: Tensor, y: Tensor, value: float) -> float:
    """y at the first point where the increasing x reaches a value."""
    return y[torch.searchsorted(x, value).clamp(max=len(x) - 1)].item()


def _interpolate(x: Tensor, y: Tensor, value: float) -> float:
    """y at a value of the increasing x, linear between (0, 0) and the points."""
    i = int(torch.searchsorted(x, value).clamp(max=len(x) - 1))
    x0, y0 = (x[i - 1].item(), y[i - 1].item()) if i else (0.0, 0.0)
    return y0 + (y[i].item() - y0) * min((value - x0) / (x[i].item() - x0), 1.0)
