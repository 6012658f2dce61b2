"""Resampling by solid angle: halves images, and averages a bilinear source over texels or pixels of another image."""

from collections.abc import Callable

import torch
from torch import Tensor
from torch.nn.functional import grid_sample

from glossbench.directions import Vec3
from glossbench.envmap.cubemap import add_border, face_coordinates, face_directions, texel_solid_angles
from glossbench.envmap.projections.layouts import Layout

# From a direction to its position in a source image (H, W, 3): (column, row) in pixels, centres at half-integers.
Locate = Callable[[Vec3], tuple[Tensor, Tensor]]

_DIRECTIONS = 2**17  # at a time: bounds the memory; more are slower, because their arrays do not fit into the cache
_FINE = 1024  # texels along an edge: up to this resolution time does not matter


def make_cube_source(faces: Tensor) -> tuple[Tensor, Locate]:
    """The faces with borders, one above the other."""
    size = faces.shape[1]

    def locate(d: Vec3) -> tuple[Tensor, Tensor]:
        face, s, t, _ = face_coordinates(d)
        return (s + 1) * (size / 2) + 1, (t + 1) * (size / 2) + 1 + face * (size + 2)

    return add_border(faces).flatten(0, 1), locate


def make_edge_source(image: Tensor) -> tuple[Tensor, Locate]:
    """Faces one above the other (6 N, N, 3), whose outer samples lie on the edges of the cube."""
    size = image.shape[1]

    def locate(d: Vec3) -> tuple[Tensor, Tensor]:
        face, s, t, _ = face_coordinates(d)
        return (s + 1) * ((size - 1) / 2) + 0.5, (t + 1) * ((size - 1) / 2) + 0.5 + face * size

    return image, locate


def make_layout_source(image: Tensor, layout: Layout) -> tuple[Tensor, Locate]:
    """The image with its margin."""
    height, width = image.shape[:2]

    def locate(d: Vec3) -> tuple[Tensor, Tensor]:
        u, v = layout.place(d)
        return u * width + 1, v * height + 1

    return layout.margin(image), locate


def to_faces(source: Tensor, locate: Locate, resolved: float, resolution: int) -> Tensor:
    """Faces (6, R, R, 3): means of the bilinear source over k x k directions per texel, by solid angle.

    resolved: texels along the edge of a cube map as fine as the source.
    """
    # Six directions along a pixel reproduce a lamp of one pixel within 1 %, four within 2 to 3 %. For 2048 texels along
    # an edge six would need 900 million directions and take minutes.
    k = max(2, round((6 if resolution <= _FINE else 4) * resolved / resolution))
    n = resolution * k
    s = (torch.arange(n, dtype=torch.float64) * 2 + 1) / n - 1
    faces = torch.empty(6, resolution, resolution, 3)
    step = max(1, _DIRECTIONS // (6 * n * k))  # rows of texels at a time
    images = source.expand(6, *source.shape)
    for row in range(0, resolution, step):
        rows = min(step, resolution - row)
        t = s[row * k : (row + rows) * k]
        shape = (len(t), n)
        directions = face_directions(s[None, :].expand(shape), t[:, None].expand(shape))
        radiance = bilinear(images, *locate(directions))
        weight = ((1 + s[None, :] ** 2 + t[:, None] ** 2) ** -1.5).float()[:, :, None]
        blocks = (rows, k, resolution, k)
        total = (radiance * weight).reshape(6, *blocks, 3).sum((2, 4))
        faces[:, row : row + rows] = total / weight.reshape(blocks).sum((1, 3))[..., None]
    return faces


def to_layout(source: Tensor, locate: Locate, resolved: float, layout: Layout, resolution: int) -> Tensor:
    """The image (H, W, 3) of a layout: means as in `to_faces`; pixels that show no direction are 0."""
    k = max(2, round(4 * resolved / resolution))
    height, width = layout.rows * resolution, layout.columns * resolution
    u = (torch.arange(width * k, dtype=torch.float64) + 0.5) / (width * k)
    image = torch.empty(height, width, 3)
    step = max(1, _DIRECTIONS // (width * k * k))
    for row in range(0, height, step):
        rows = min(step, height - row)
        v = (torch.arange(row * k, (row + rows) * k, dtype=torch.float64) + 0.5) / (height * k)
        direction, density = layout.direction(*torch.broadcast_tensors(u[None, :], v[:, None]))
        radiance = bilinear(source[None], *locate(Vec3(*(c.float()[None] for c in direction))))[0]
        blocks = (rows, k, width, k)
        total = (radiance * density.float()[:, :, None]).reshape(*blocks, 3).sum((1, 3))
        image[row : row + rows] = total / density.float().reshape(blocks).sum((1, 3)).clamp(min=1e-30)[..., None]
    return image


def resize(faces: Tensor, resolution: int) -> Tensor:
    """Faces at another resolution: averages of 2 x 2 texels, and interpolation if these do not lead to it."""
    size = faces.shape[1]
    exact = size % resolution == 0 and (size // resolution).bit_count() == 1
    while size > (resolution if exact else 2 * resolution):
        faces, size = halve_images(faces, texel_solid_angles(size)), size // 2
    return faces.contiguous() if exact else to_faces(*make_cube_source(faces), size, resolution)


def halve_images(images: Tensor, weight: Tensor) -> Tensor:
    """Means (N, H // 2, W // 2, 3) over 2 x 2 pixels of images (N, H, W, 3), weighted by (H, W).

    For an odd H the means are over bins of H / (H // 2) pixels; a pixel counts with its share in the bin. If W is a
    multiple of H, as for two discs, it stays this multiple.
    """
    n, height, width, _ = images.shape
    w = weight.float()[None, :, :, None]
    if height % 2 or width % 2:
        rows = height // 2
        columns = width // 2 if width % height else rows * (width // height)
        total, weights = (_sum_bins(_sum_bins(x, rows, 1), columns, 2) for x in (images * w, w))
        return total / weights.clamp(min=1e-30)
    blocks = (n, height // 2, 2, width // 2, 2, -1)
    total = (images * w).reshape(blocks).sum((2, 4))
    return total / w.reshape(1, *blocks[1:]).sum((2, 4)).clamp(min=1e-30)


def _sum_bins(x: Tensor, n_bins: int, dim: int) -> Tensor:
    """Sums over equal bins along a dimension; a bin covers two or three pixels, those at its edges partly."""
    size = x.shape[dim] / n_bins
    shape = [-1 if d == dim else 1 for d in range(x.dim())]
    start = torch.arange(n_bins, dtype=torch.float64) * size
    total = torch.zeros(())
    for k in range(int(size) + 2):
        pixel = start.floor() + k
        share = (torch.minimum(start + size, pixel + 1) - torch.maximum(start, pixel)).clamp(min=0)
        of = x.index_select(dim, pixel.long().clamp(max=x.shape[dim] - 1))
        total = total + of * share.float().view(shape)
    return total


def bilinear(images: Tensor, column: Tensor, row: Tensor) -> Tensor:
    """Bilinear values (N, h, w, 3) of images (N, H, W, 3) at positions (N, h, w) in pixels."""
    height, width = images.shape[1:3]
    grid = torch.stack([column * (2 / width) - 1, row * (2 / height) - 1], dim=-1)
    planes = images.permute(0, 3, 1, 2)
    return grid_sample(planes, grid, padding_mode="border", align_corners=False).permute(0, 2, 3, 1)
