"""Median cut: divides the faces of a cube into rectangles of about equal power."""

from dataclasses import dataclass
from math import ceil, floor

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from glossbench.channels import LUMINANCE
from glossbench.directions import Vec3, normalize, stack, vec3
from glossbench.envmap.cubemap import CubeMap, texel_directions, texel_solid_angles
from glossbench.errors import InputError

Box = tuple[int, int, int, int]  # rows [top, bottom), columns [left, right)


@dataclass(frozen=True)
class Partition:
    """A light in N regions. Each is a rectangle of texels on one face; if N is 1, the region is the whole light.

    Attributes:
        index: region of each texel, (6, R, R), int32 in [0, N).
        direction: the direction to each region, unit, components (N,): its centroid weighted by luminance times solid
            angle, or by solid angle if the region is black; +y if the centroid is zero, as for a constant light in one
            region.
        power: integral of the radiance over each region, (N, 3).
        solid_angle: solid angle of each region, (N,) [sr]; the sum is 4 pi.

    All float32.
    """

    index: Tensor
    direction: Vec3
    power: Tensor
    solid_angle: Tensor

    def __len__(self) -> int:
        return self.solid_angle.shape[0]


def make_whole(light: CubeMap) -> Partition:
    """The light as one region."""
    return _describe_regions(light, torch.zeros(light.faces.shape[:3], dtype=torch.int32), 1)


def median_cut(light: CubeMap, n_regions: int) -> Partition:
    """N regions: each face is divided into N / 6 regions of about equal power.

    A rectangle for n regions is cut across its longer side, so that the power of the first part is nearest to
    ceil(n / 2) / n of the whole. The parts are then divided into ceil(n / 2) and n - ceil(n / 2) regions. Power is
    luminance times exact solid angle. If N is not a multiple of six, the brightest faces have one more region. If a
    part has fewer texels than regions, the other part gets the surplus regions. A black rectangle is cut by area.

    Raises:
        InputError: there are fewer than 6 regions, or more regions than texels.

    Source: Debevec 2008, "A median cut algorithm for light probe sampling"; on each face Knuth et al. 2014, section 4.
    Differs: for N / 6 = 2^k the same cuts, but any N is possible; the solid angle is that of a cube's texel.
    """
    r = light.resolution
    if not 6 <= n_regions <= 6 * r * r:
        raise InputError(f"a median cut of a cube of {r}^2 texels needs 6 to {6 * r * r} regions, got {n_regions}")
    weights = torch.tensor(LUMINANCE, dtype=torch.float64)
    power = (light.faces.cpu().double() @ weights) * texel_solid_angles(r)
    counts = [n_regions // 6] * 6
    brightest = power.sum((1, 2)).argsort(descending=True, stable=True).tolist()
    for face in brightest[: n_regions % 6]:
        counts[face] += 1
    index = torch.empty(6, r, r, dtype=torch.int32)
    first = 0
    for face, n in enumerate(counts):
        for region, (top, bottom, left, right) in enumerate(_cut_boxes(power[face].numpy(), n), start=first):
            index[face, top:bottom, left:right] = region
        first += n
    return _describe_regions(light, index, n_regions)


def _cut_boxes(power: NDArray[np.float64], n_regions: int) -> list[Box]:
    """Rectangles of one face."""
    r = power.shape[0]
    done: list[Box] = []
    pending: list[tuple[Box, int]] = [((0, r, 0, r), n_regions)]
    while pending:
        box, n = pending.pop()
        if n == 1:
            done.append(box)
            continue
        top, bottom, left, right = box
        upright = bottom - top >= right - left
        inside = power[top:bottom, left:right]
        length, width = inside.shape if upright else inside.shape[::-1]
        share = ceil(n / 2) / n
        cumulative = inside.sum(1 if upright else 0).cumsum()
        if cumulative[-1] > 0:
            cut = int(np.abs(cumulative[:-1] - share * cumulative[-1]).argmin()) + 1
        else:
            cut = min(max(floor(share * length + 0.5), 1), length - 1)
        n_first = min(max(ceil(n / 2), n - (length - cut) * width, 1), cut * width, n - 1)
        if upright:
            parts = (top, top + cut, left, right), (top + cut, bottom, left, right)
        else:
            parts = (top, bottom, left, left + cut), (top, bottom, left + cut, right)
        pending += [(parts[1], n - n_first), (parts[0], n_first)]
    return done


def _describe_regions(light: CubeMap, index: Tensor, n: int) -> Partition:
    """The partition with a given region for each texel."""
    device = light.faces.device
    region = index.reshape(-1).long()
    solid_angle = texel_solid_angles(light.resolution).expand(6, -1, -1).reshape(-1)
    radiance = light.faces.cpu().reshape(-1, 3).double()
    d = stack(texel_directions(light.resolution)).reshape(-1, 3).double()
    weight = (radiance @ torch.tensor(LUMINANCE, dtype=torch.float64)) * solid_angle

    def sum_by_region(values: Tensor) -> Tensor:
        return torch.zeros(n, *values.shape[1:], dtype=torch.float64).index_add_(0, region, values)

    bright, plain = sum_by_region(d * weight[:, None]), sum_by_region(d * solid_angle[:, None])
    mass, area = sum_by_region(weight)[:, None], sum_by_region(solid_angle)[:, None]
    centroid = torch.where(mass > 0, bright / mass.clamp(min=1e-300), plain / area)
    up = torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)
    centroid = torch.where(centroid.norm(dim=1, keepdim=True) > 1e-6, centroid, up)
    direction = normalize(vec3(centroid))
    return Partition(
        index.to(device),
        Vec3(*(c.float().to(device) for c in direction)),
        sum_by_region(radiance * solid_angle[:, None]).float().to(device),
        area[:, 0].float().to(device),
    )
