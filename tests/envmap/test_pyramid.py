"""Pyramids: seams, and the lookup against one without a flat table."""

import numpy as np
import pytest
import torch
from scipy import ndimage

from glossbench.directions import Vec3, stack, vec3
from glossbench.envmap.cubemap import CubeMap, texel_directions
from glossbench.envmap.pyramid import Pyramid, finest, lookup, weighted_radiance
from glossbench.prefilter.pyramids import FILTERS, build_mip_levels, build_pyramid
from oracles.cube_by_hand import FACES


def random_light(resolution, seed=0):
    # Heavy tails, as light has.
    faces = torch.randn(6, resolution, resolution, 3, generator=torch.Generator().manual_seed(seed)).exp()
    return CubeMap(faces)


def random_directions(n, seed=0):
    v = np.random.default_rng(seed).normal(size=(n, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


# Seams


def at_edges(epsilon, n=40):
    """Directions an epsilon either side of all 12 edges, (12 n, 3) twice, from edge to edge."""
    first, second = [], []
    along = np.linspace(-0.999, 0.999, n)
    for a in range(3):
        for sign_b in (-1, 1):
            for sign_c in (-1, 1):
                b, c = (a + 1) % 3, (a + 2) % 3
                for points, (u, v) in ((first, (1, 1 - epsilon)), (second, (1 - epsilon, 1))):
                    p = np.zeros((n, 3))
                    p[:, a], p[:, b], p[:, c] = along, sign_b * u, sign_c * v
                    points.append(p / np.linalg.norm(p, axis=1, keepdims=True))
    return (vec3(torch.tensor(np.concatenate(points)).float()) for points in (first, second))


def largest_seam(pyramid):
    """Largest step across an edge at any level, over the largest difference of two texels of that level."""
    one, other = at_edges(1e-6)
    steps = []
    for level in range(len(pyramid.sizes)):
        lod = torch.full_like(one.x, float(level))
        step = (lookup(pyramid, one, lod) - lookup(pyramid, other, lod)).abs().max()
        values = pyramid.level(level)
        steps.append((step / (values.max() - values.min())).item())
    return max(steps)


@pytest.mark.parametrize("mip_filter", FILTERS)
def test_radiance_is_continuous_across_edges_at_every_level(mip_filter):
    pyramid = build_pyramid(random_light(32), mip_filter)

    seam = largest_seam(pyramid)

    # An epsilon of 1e-6 is 3e-5 texels at R = 32; measured 1.3e-5.
    assert seam < 1e-4


@pytest.mark.parametrize("fault", ["zeros", "repeated"])
def test_the_seam_check_notices_a_border_without_the_neighbours(fault):
    def wrong(images, width, out):
        mode = "constant" if fault == "zeros" else "replicate"
        planes = images.permute(0, 3, 1, 2)
        return out.copy_(torch.nn.functional.pad(planes, (width,) * 4, mode).permute(0, 2, 3, 1))

    pyramid = Pyramid(*build_mip_levels(random_light(32).faces, FILTERS["box"], wrong))

    seam = largest_seam(pyramid)

    assert seam > 0.1


# The lookup


def padded(faces):
    """Faces with one texel of their neighbours around them, each found by the nearest direction."""
    n = faces.shape[1]
    at = (np.arange(n) * 2 + 1) / n - 1
    t, s = np.meshgrid(at, at, indexing="ij")
    d = FACES[:, None, None, 0] + s[..., None] * FACES[:, None, None, 1] + t[..., None] * FACES[:, None, None, 2]
    d /= np.linalg.norm(d, axis=-1, keepdims=True)
    flat, colors = d.reshape(-1, 3), faces.reshape(-1, 3)
    out = np.zeros((6, n + 2, n + 2, 3))
    out[:, 1:-1, 1:-1] = faces
    for face in range(6):
        normal, right, down = FACES[face]
        for index, side, inside in (
            (np.s_[0, 1:-1], -down, np.s_[0, :]),
            (np.s_[-1, 1:-1], down, np.s_[-1, :]),
            (np.s_[1:-1, 0], -right, np.s_[:, 0]),
            (np.s_[1:-1, -1], right, np.s_[:, -1]),
        ):
            # Mirrored in the plane between the two faces, a texel next to the edge is the one across it.
            across = d[face][inside] - (d[face][inside] @ (normal - side))[:, None] * (normal - side)
            out[face][index] = colors[(across @ flat.T).argmax(1)]
        for i in (0, -1):
            for j in (0, -1):
                beside = (1 if i == 0 else -2), (1 if j == 0 else -2)
                out[face, i, j] = (out[face][beside] + out[face][i, beside[1]] + out[face][beside[0], j]) / 3
    return out


def trilinear(faces_of_levels, d, lod):
    """Radiance by scipy's bilinear interpolation on each face and level, with its own borders."""
    levels = [padded(faces) for faces in faces_of_levels]
    lod = np.clip(lod, 0, len(levels) - 1)
    out = np.zeros((len(d), 3))
    for i, direction in enumerate(d):
        face = np.argmax(FACES[:, 0] @ direction)
        point = direction / (FACES[face, 0] @ direction)
        s, t = FACES[face, 1] @ point, FACES[face, 2] @ point
        low = int(lod[i])
        for level, share in ((low, 1 - lod[i] + low), (min(low + 1, len(levels) - 1), lod[i] - low)):
            n = levels[level].shape[1] - 2
            at = [[(t + 1) / 2 * n + 0.5], [(s + 1) / 2 * n + 0.5]]
            for c in range(3):
                out[i, c] += share * ndimage.map_coordinates(levels[level][face, ..., c], at, order=1)[0]
    return out


def check_lookup(pyramid, faces_of_levels, n=150):
    near_edges = np.concatenate([stack(d).double().numpy()[::8] for d in at_edges(0.02)])
    d = np.concatenate([random_directions(n), near_edges])
    lod = np.random.default_rng(1).uniform(-1, len(faces_of_levels) + 1, len(d))
    as_tensors = vec3(torch.tensor(d).float()), torch.tensor(lod).float()

    radiance = lookup(pyramid, *as_tensors).numpy()

    expected = trilinear(faces_of_levels, d, lod)
    # Measured 8e-6 of at most 40: float32.
    np.testing.assert_allclose(radiance, expected, atol=5e-5)


@pytest.mark.parametrize("mip_filter", FILTERS)
def test_the_lookup_is_trilinear(mip_filter):
    pyramid = build_pyramid(random_light(8), mip_filter)

    check_lookup(pyramid, [pyramid.level(i).double().numpy() for i in range(4)])


@pytest.mark.parametrize("fault", ["levels turned", "rows and columns exchanged", "half a texel off"])
def test_the_lookup_check_notices(fault):
    pyramid = build_pyramid(random_light(8), "box")
    levels = [pyramid.level(i).double().numpy() for i in range(4)]
    if fault == "levels turned":
        levels[1] = levels[1][[1, 0, 2, 3, 4, 5]]
    elif fault == "rows and columns exchanged":
        levels = [level.transpose(0, 2, 1, 3) for level in levels]
    else:
        levels[0] = (levels[0] + np.roll(levels[0], 1, axis=2)) / 2

    with pytest.raises(AssertionError):
        check_lookup(pyramid, levels)


def test_at_a_texel_centre_the_lookup_is_the_texel():
    light = random_light(16)
    d = Vec3(*(c.reshape(-1) for c in texel_directions(16)))

    radiance = lookup(finest(light), d)

    # Measured 2.4e-5 for texels of up to 40: the centre in float32.
    torch.testing.assert_close(radiance, light.faces.reshape(-1, 3), rtol=1e-5, atol=1e-4)


def test_levels_outside_the_pyramid_are_clamped():
    pyramid = build_pyramid(random_light(8), "gauss4")
    d = vec3(torch.tensor(random_directions(50)).float())

    below, first, above, last = (lookup(pyramid, d, torch.full((50,), lod)) for lod in (-3.0, 0.0, 99.0, 3.0))

    assert torch.equal(below, first)
    assert torch.equal(above, last)
    torch.testing.assert_close(first, lookup(pyramid, d))


@pytest.mark.parametrize("n_channels", [1, 3])
@pytest.mark.parametrize("with_lod", [True, False])
def test_weighted_radiance_is_the_sum_over_samples(n_channels, with_lod):
    n_points, n_samples = 5, 7
    pyramid = build_pyramid(random_light(8), "gauss6")
    rng = np.random.default_rng(2)
    d = random_directions(n_points * n_samples, 3)
    lod = rng.uniform(0, 3, len(d)) if with_lod else np.zeros(len(d))
    weight = rng.uniform(0, 2, (n_channels, n_points, n_samples))

    total = weighted_radiance(
        pyramid,
        Vec3(*torch.tensor(d.T.reshape(3, n_points, n_samples)).float()),
        torch.tensor(lod.reshape(n_points, n_samples)).float() if with_lod else None,
        tuple(torch.tensor(weight).float()),
    )

    each = trilinear([pyramid.level(i).double().numpy() for i in range(4)], d, lod).reshape(n_points, n_samples, 3)
    expected = np.einsum("cpn,pnc->pc", np.broadcast_to(weight, (3, n_points, n_samples)), each)
    # Measured 3e-7: float32.
    np.testing.assert_allclose(total.numpy(), expected, rtol=3e-6)
    if n_channels == 3:
        exchanged = np.einsum("cpn,pnc->pc", weight[::-1], each)
        assert not np.allclose(total.numpy(), exchanged, rtol=1e-2)


def test_texels_a_steradian_are_the_inverse_of_the_solid_angle():
    resolution = 32
    pyramid = finest(random_light(resolution))
    s = np.array([0.0, 0.5, 0.9, 0.99])
    points = np.stack([s, -s, np.ones(4)], 1)
    d = points / np.linalg.norm(points, axis=1, keepdims=True)

    log2_count = pyramid.log2_texels_per_sr(vec3(torch.tensor(d).float()))

    # A square of the face of edge e about (s, t) subtends e^2 / (1 + s^2 + t^2)^(3/2) in the limit.
    expected = resolution**2 / 4 * (1 + 2 * s**2) ** 1.5
    # Measured 3e-7.
    np.testing.assert_allclose(2 ** log2_count.numpy(), expected, rtol=2e-6)
