"""Cube maps: texels and directions, solid angles, borders across edges, irradiance."""

from math import pi

import numpy as np
import pytest
import torch
from scipy.integrate import dblquad

import glossbench as gb
from glossbench.directions import stack, vec3
from glossbench.envmap.cubemap import (
    CubeMap,
    add_border,
    face_coordinates,
    face_directions,
    texel_directions,
    texel_solid_angles,
)
from glossbench.errors import InputError

# Normal, right-hand side and lower side of each face, from the table in words: no code shared.
FACES = {0: ("+x", "+z", "-y"), 1: ("-x", "-z", "-y"), 2: ("+y", "+x", "-z"),
         3: ("-y", "+x", "+z"), 4: ("+z", "-x", "-y"), 5: ("-z", "+x", "-y")}  # fmt: skip
# red, cyan, green, magenta, blue, yellow
COLORS = {
    "+x": (1, 0, 0),
    "-x": (0, 1, 1),
    "+y": (0, 1, 0),
    "-y": (1, 0, 1),
    "+z": (0, 0, 1),
    "-z": (1, 1, 0),
}
SIDES = ("top", "bottom", "left", "right")


def axis(name):
    return np.array([float(f"{name[0]}1") * (name[1] == letter) for letter in "xyz"])


def random_directions(n, seed=0):
    v = np.random.default_rng(seed).normal(size=(n, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


# Texels and directions


@pytest.mark.parametrize("resolution", [1, 2, 8, 512])
def test_a_texel_goes_to_its_direction_and_back(resolution):
    face, s, t, _ = face_coordinates(texel_directions(resolution))

    column, row = ((c.double() + 1) * resolution / 2 - 0.5 for c in (s, t))
    at = torch.arange(resolution).double()
    assert (face == torch.arange(6)[:, None, None]).all()
    # Measured 6e-8 of an edge: float32.
    assert (column - at[None, None, :]).abs().max().item() < 2e-7 * resolution
    assert (row - at[None, :, None]).abs().max().item() < 2e-7 * resolution


def test_a_direction_goes_to_its_place_on_the_cube_and_back():
    d = random_directions(1000)

    face, s, t, major = face_coordinates(vec3(torch.tensor(d)))

    for i in range(len(d)):
        normal, right, down = (axis(name) for name in FACES[int(face[i])])
        point = normal + right * s[i].item() + down * t[i].item()
        # Measured 1e-16.
        np.testing.assert_allclose(point * major[i].item(), d[i], atol=1e-15)
    assert major.numpy() == pytest.approx(np.abs(d).max(1))
    assert max(s.abs().max(), t.abs().max()) <= 1


def test_faces_are_seen_from_the_inside_of_a_right_handed_world():
    d = face_directions(torch.tensor([0.0, 0.5, 0.0]), torch.tensor([0.0, 0.0, 0.5]))

    centre, right, down = (np.array([c[:, i].tolist() for c in d]).T for i in range(3))
    # Looking along the normal with the image upright, right x down points away from the viewer.
    turn = np.einsum("fi,fi->f", np.cross(right, down), centre)
    assert (turn > 0).all()
    for face, names in FACES.items():
        np.testing.assert_allclose(centre[face], axis(names[0]), atol=1e-7)
        assert right[face] @ axis(names[1]) > 0.4
        assert down[face] @ axis(names[2]) > 0.4


@pytest.mark.parametrize("name", COLORS)
def test_the_orientation_light_has_its_colour_along_each_axis(name):
    light = gb.light("orientation", resolution=16)
    d = vec3(torch.tensor(axis(name)[None] + [[0.011, -0.007, 0.013]]))

    face, s, t, _ = face_coordinates(d)

    texel = light.faces[face.item(), int((t.item() + 1) * 8), int((s.item() + 1) * 8)]
    assert (texel / texel.max()).tolist() == list(COLORS[name])


@pytest.mark.parametrize(("name", "right", "up"), [("-z", "+x", "+y"), ("+x", "+z", "+y"), ("+z", "-x", "+y")])
def test_the_upper_left_quarter_of_the_orientation_light_is_bright(name, right, up):
    light = gb.light("orientation", resolution=16)

    brightness = {}
    for across in (-0.5, 0.5):
        for along in (-0.5, 0.5):
            d = vec3(torch.tensor(axis(name) + across * axis(right) + along * axis(up))[None])
            face, s, t, _ = face_coordinates(d)
            texel = light.faces[face.item(), int((t.item() + 1) * 8), int((s.item() + 1) * 8)]
            brightness[across, along] = texel.max().item()

    assert brightness == {(-0.5, 0.5): 2, (-0.5, -0.5): 1, (0.5, 0.5): 1, (0.5, -0.5): 1}


# Solid angles


def check_solid_angles(angles, resolution):
    edge = np.linspace(-1, 1, resolution + 1)
    for row, column in [(0, 0), (0, resolution // 2), (resolution // 2, resolution // 2), (1, 0)]:
        box = (edge[row], edge[row + 1], edge[column], edge[column + 1])
        expected, _ = dblquad(lambda s, t: (1 + s * s + t * t) ** -1.5, *box, epsabs=1e-13, epsrel=1e-12)
        # Measured 2e-17.
        assert angles[row, column].item() == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize("resolution", [2, 5, 16])
def test_a_texel_subtends_the_integral_of_its_area(resolution):
    angles = texel_solid_angles(resolution)

    check_solid_angles(angles, resolution)


@pytest.mark.parametrize("resolution", [1, 2, 64, 1024])
def test_texels_subtend_the_sphere(resolution):
    total = 6 * texel_solid_angles(resolution).sum().item()

    # Measured 1e-14 at 1024, rounding of a million differences.
    assert total == pytest.approx(4 * pi, abs=1e-13)


def test_the_quadrature_notices_the_approximate_solid_angle():
    resolution = 16
    d = stack(texel_directions(resolution))[5].double()
    approximate = 4 / resolution**2 * d.abs().amax(-1) ** 3

    with pytest.raises(AssertionError):
        check_solid_angles(approximate, resolution)

    # 4 / R^2 major^3 errs by up to 0.38 % at R = 16, at the middle of the face.
    worst = (approximate / texel_solid_angles(resolution) - 1).abs().max().item()
    assert 3e-3 < worst < 4e-3


# Borders


def mirrored(d, normal, neighbour):
    """Directions mirrored in the plane between two faces: beyond an edge lies its own inside, mirrored."""
    difference = axis(normal) - axis(neighbour)
    return d - (d @ difference)[..., None] * difference


def beyond(face, side):
    """The neighbour's name, by the face's table."""
    _, right, down = FACES[face]
    opposite = {"+": "-", "-": "+"}
    return {
        "bottom": down,
        "top": opposite[down[0]] + down[1],
        "right": right,
        "left": opposite[right[0]] + right[1],
    }[side]


def strip(image, side, width):
    """The border of a padded image beyond one side, nearest row first, and the same rows inside."""
    turned = {
        "top": image,
        "bottom": image.flip(0),
        "left": image.transpose(0, 1),
        "right": image.transpose(0, 1).flip(0),
    }[side]
    inner = slice(width, -width)
    return turned[:width].flip(0)[:, inner], turned[width : 2 * width][:, inner]


def largest_gap(padded, width):
    """Largest distance between what the border holds and the mirrored inside, over 24 sides of 12 edges."""
    gaps = []
    for face, (normal, _, _) in FACES.items():
        for side in SIDES:
            border, inside = strip(padded[face].double(), side, width)
            gaps.append(np.abs(border.numpy() - mirrored(inside.numpy(), normal, beyond(face, side))).max())
    return max(gaps)


@pytest.mark.parametrize("width", [1, 2])
@pytest.mark.parametrize("resolution", [2, 4, 16])
def test_a_border_holds_the_neighbours_texels_on_all_edges(resolution, width):
    directions = stack(texel_directions(resolution))

    padded = add_border(directions, width)

    # Measured 0; a float32 component may differ in its last digit.
    assert largest_gap(padded, width) < 2e-7
    assert torch.equal(padded[:, width:-width, width:-width], directions)


def test_the_state_of_torch_at_the_first_call_does_not_stay_in_later_ones():
    faces = torch.rand(6, 300, 300, 3)  # a resolution of which no other test asks
    torch.set_default_dtype(torch.bfloat16)
    try:
        with torch.inference_mode():
            first = add_border(faces)
    finally:
        torch.set_default_dtype(torch.float32)

    later = add_border(faces.requires_grad_())

    later.sum().backward()
    assert torch.equal(later, first)
    assert largest_gap(add_border(stack(texel_directions(300))), 1) < 2e-7  # measured 0


@pytest.mark.parametrize("resolution", [16, 64])
def test_directions_vary_continuously_across_every_edge(resolution):
    padded = add_border(stack(texel_directions(resolution)))

    for face in range(6):
        for side in SIDES:
            border, inside = strip(padded[face], side, 1)
            chord = (border - inside).norm(dim=-1)
            # Texels whose centres lie half a texel, 1 / R, either side of an edge, sqrt(2) to sqrt(3) away.
            assert chord.max().item() < 2**0.5 / resolution * 1.01
            assert chord.min().item() > 0.5 / resolution


@pytest.mark.parametrize("fault", ["reversed edge", "zeros", "repeated own edge", "opposite face"])
def test_the_border_check_notices(fault):
    directions = stack(texel_directions(8))
    padded = add_border(directions)
    if fault == "reversed edge":
        padded[2, 0, 1:-1] = padded[2, 0, 1:-1].flip(0)
    elif fault == "zeros":
        padded[5, 1:-1, 0] = 0
    elif fault == "repeated own edge":
        padded[0, -1, 1:-1] = padded[0, -2, 1:-1]
    else:
        padded[4, 1:-1, -1] = padded[5, 1:-1, -1]

    gap = largest_gap(padded, 1)

    # The least of them, a repeated edge, is one texel off: 0.09.
    assert gap > 0.05


@pytest.mark.parametrize("width", [1, 2])
def test_beyond_a_corner_is_the_mean_of_the_three_texels_that_meet_there(width):
    resolution = 4
    directions = stack(texel_directions(resolution))
    values = torch.rand(6, resolution, resolution, 3, generator=torch.Generator().manual_seed(0))

    padded = add_border(values, width)

    # Found by angle: the three texels nearest to the cube's corner.
    flat, colors = directions.reshape(-1, 3), values.reshape(-1, 3)
    for face, (normal, right, down) in FACES.items():
        for rows, sign_down in ((slice(0, width), -1), (slice(-width, None), 1)):
            for columns, sign_right in ((slice(0, width), -1), (slice(-width, None), 1)):
                corner = axis(normal) + sign_right * axis(right) + sign_down * axis(down)
                nearest = (flat @ torch.tensor(corner).float()).topk(3).indices
                expected = colors[nearest].mean(0).expand(width, width, 3)
                # Measured 1e-7: the order of a float32 sum.
                torch.testing.assert_close(padded[face, rows, columns], expected, rtol=0, atol=3e-7)


# The light as a whole


@pytest.mark.parametrize(
    ("faces", "message"),
    [
        (torch.zeros(6, 4, 4), "faces (6, R, R, 3)"),
        (torch.zeros(5, 4, 4, 3), "faces (6, R, R, 3)"),
        (torch.zeros(6, 4, 8, 3), "faces (6, R, R, 3)"),
        (torch.zeros(6, 6, 6, 3), "power of two"),
        (torch.zeros(6, 1, 1, 3), "at least 2"),
        (torch.full((6, 4, 4, 3), torch.nan), "finite"),
        (torch.full((6, 4, 4, 3), torch.inf), "finite"),
        (torch.full((6, 4, 4, 3), -0.5), "negative, got a minimum of -0.5"),
    ],
)
def test_a_cube_map_that_cannot_be_light_is_refused_in_one_line(faces, message):
    with pytest.raises(InputError) as raised:
        CubeMap(faces)

    assert message in str(raised.value)
    assert "\n" not in str(raised.value)


def test_the_mean_of_a_gradient_is_half_its_radiance():
    mean = gb.light("gradient", radiance=3.0, resolution=32).mean()

    # By symmetry exact; measured 2e-9.
    torch.testing.assert_close(mean, torch.full((3,), 1.5).double(), rtol=0, atol=2e-8)


def test_the_mean_notices_texels_that_all_count_the_same():
    cap = (stack(texel_directions(32))[..., 2:] > 0.9).float().expand(-1, -1, -1, 3)

    mean, unweighted = CubeMap(cap).mean()[0].item(), cap.mean().item()

    # A cap of height 0.1 covers 1/20 of the sphere; its jagged rim costs 0.8 %.
    assert mean == pytest.approx(0.05, rel=0.015)
    assert unweighted != pytest.approx(0.05, rel=0.2)


def check_irradiance(irradiance_of, normals):
    """Of L = max(a . d, 0): E = (2/3) (sin g + (pi - g) cos g) at the angle g from a."""
    a = np.array([2.0, -1.0, 2.0]) / 3
    lobe = (stack(texel_directions(32)) @ torch.tensor(a).float()).clamp(min=0)[..., None].expand(-1, -1, -1, 3)
    angle = np.arccos(np.clip(normals @ a, -1, 1))
    expected = (2 / 3 * (np.sin(angle) + (pi - angle) * np.cos(angle)))[:, None].repeat(3, 1)

    irradiance = irradiance_of(CubeMap(lobe.contiguous()), vec3(torch.tensor(normals).float()))

    # Measured 1.7e-4 at 32 texels per edge, of at most 2 pi / 3: a texel's centre represents the texel.
    np.testing.assert_allclose(irradiance.numpy(), expected, atol=5e-4)


def test_irradiance_of_a_cosine_lobe_is_the_closed_form():
    a = np.array([[2.0, -1.0, 2.0]]) / 3
    normals = np.concatenate([a, -a, random_directions(30, 4)])

    check_irradiance(CubeMap.irradiance, normals)


def test_the_irradiance_check_notices_a_dropped_cosine():
    def dropped(light, n):
        above = (stack(texel_directions(light.resolution)).reshape(-1, 3) @ stack(n).T > 0).double()
        weighted = light.faces.double() * texel_solid_angles(light.resolution)[:, :, None]
        return above.T @ weighted.reshape(-1, 3)

    with pytest.raises(AssertionError):
        check_irradiance(dropped, random_directions(5, 4))


def test_irradiance_of_a_constant_and_of_a_gradient_is_the_closed_form():
    normals = random_directions(20, 2)
    n = vec3(torch.tensor(normals).float())

    constant = gb.light("constant", radiance=[1.0, 2.0, 3.0]).irradiance(n)
    gradient = gb.light("gradient", radiance=2.0, resolution=32).irradiance(n)

    # Measured 2e-4 at 16 and 1.2e-4 at 32 texels an edge, where a horizon cuts texels.
    np.testing.assert_allclose(constant.numpy(), np.array([[pi, 2 * pi, 3 * pi]]).repeat(20, 0), rtol=6e-4)
    np.testing.assert_allclose(gradient.numpy(), pi * (1 + 2 * normals / 3), atol=4e-4)
