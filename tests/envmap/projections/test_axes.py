"""Axis conventions: an image drawn by a program's own formula shows, in our world, the same scene, not mirrored."""

from math import pi

import numpy as np
import pytest
import torch

from glossbench.directions import Vec3
from glossbench.envmap.cubemap import texel_directions
from glossbench.envmap.formats.files import write_exr
from glossbench.envmap.lights.file_light import FileLight
from glossbench.envmap.lights.light import LIGHTS
from glossbench.envmap.projections.axes import _CONVENTIONS, permutation, turn_faces
from glossbench.envmap.projections.conversion import from_cubemap, to_cubemap
from glossbench.errors import InputError

SIZE = 24  # texels along the edge of a cube that resolves as much as the images
COLOURS = np.array([[1, 0, 0], [0, 1, 1], [0, 1, 0], [1, 0, 1], [0, 0, 1], [1, 1, 0]])


# What each program does with a direction of its world: the place (u, v) in its image, v downward.


def mitsuba(x, y, z):
    return (np.arctan2(x, -z) / (2 * pi)) % 1, np.arccos(y) / pi


def blender(x, y, z):
    # Blender counts v from the bottom.
    return 0.5 - np.arctan2(y, x) / (2 * pi), 1 - (1 - np.arccos(z) / pi)


def pbrt_v3(x, y, z):
    return (np.arctan2(y, x) / (2 * pi)) % 1, np.arccos(z) / pi


def pbrt_v4(x, y, z):
    r = np.sqrt(1 - abs(z))
    v = np.arctan2(abs(y), abs(x)) * 2 / pi * r
    u = r - v
    u, v = np.where(z < 0, 1 - v, u), np.where(z < 0, 1 - u, v)
    return (np.copysign(u, x) + 1) / 2, (np.copysign(v, y) + 1) / 2


def nvdiffrec(x, y, z):
    return np.arctan2(x, -z) / (2 * pi) + 0.5, np.arccos(y) / pi


def texture_lookup(x, y, z):
    """Table 8.19 of OpenGL 4.6, and Direct3D's: face, s and t; the faces in a row."""
    a = np.stack([x, y, z])
    face = 2 * abs(a).argmax(0)
    face = face + (np.take_along_axis(a, face[None] // 2, 0)[0] < 0)
    sc = np.choose(face, [-z, z, x, x, x, -x])
    tc = np.choose(face, [-y, -y, z, -z, -y, -y])
    ma = abs(a).max(0)
    return (face + (sc / ma + 1) / 2) / 6, (tc / ma + 1) / 2


def same(x, y, z):
    return x, y, z


# Ours to the program's world.
PROGRAMS = [
    ("mitsuba", "lat_long", same, mitsuba),
    ("blender", "lat_long", lambda x, y, z: (x, -z, y), blender),
    ("pbrt", "lat_long", lambda x, y, z: (x, z, y), pbrt_v3),
    ("pbrt", "octahedral_equal_area", lambda x, y, z: (x, z, y), pbrt_v4),
    ("nvdiffrec", "lat_long", same, nvdiffrec),
    ("nvdiffrec", "strip", same, texture_lookup),
    ("opengl", "strip", same, texture_lookup),
    ("directx", "strip", lambda x, y, z: (x, y, -z), texture_lookup),
]
IDS = [f"{axes}-{projection}" for axes, projection, *_ in PROGRAMS]


def marked(v):
    """Six colours, one a face; four times as bright in one corner of each, so that a turned face shows too."""
    major = abs(v).argmax(0)
    face = 2 * major + (np.take_along_axis(v, major[None], 0)[0] < 0)
    beside = np.minimum(*(np.take_along_axis(v, (major[None] + k) % 3, 0)[0] for k in (1, 2)))
    return COLOURS[face] * np.where(beside > 0, 4.0, 1.0)[:, None]


def drawn(projection, world, place):
    """The image in which a program finds the marked scene: each of many directions colours its pixel."""
    v = torch.stack(texel_directions(16 * SIZE)).flatten(1).double().numpy()
    height, width = {"lat_long": (2 * SIZE, 4 * SIZE), "strip": (SIZE, 6 * SIZE)}.get(projection, (4 * SIZE, 4 * SIZE))
    u, t = place(*world(*v))
    image = np.full((height, width, 3), np.nan)
    image[np.clip(t * height, 0, height - 1).astype(int), np.clip(u * width, 0, width - 1).astype(int)] = marked(v)
    assert not np.isnan(image).any()
    return torch.from_numpy(image).float()


def wrong_share(image, projection, axes):
    """Share of the texels that do not show the marked scene where it is, edges of colours left out."""
    light = to_cubemap(image, projection, 16, axes=axes)
    d = torch.stack(texel_directions(16)).flatten(1).double().numpy()
    a = np.sort(abs(d) / abs(d).max(0), axis=0)
    clear = (a[1] < 0.8) & (a[0] > 0.2)
    wrong = abs(light.faces.reshape(-1, 3).numpy() - marked(d)).max(1) > 0.01
    return wrong[clear].mean()


@pytest.mark.parametrize(("axes", "projection", "world", "place"), PROGRAMS, ids=IDS)
def test_the_image_of_a_program_shows_each_colour_in_its_direction(axes, projection, world, place):
    image = drawn(projection, world, place)

    assert wrong_share(image, projection, axes) == 0


@pytest.mark.parametrize(("axes", "projection", "world", "place"), PROGRAMS, ids=IDS)
def test_the_colour_check_notices_a_mirrored_world(axes, projection, world, place):
    image = drawn(projection, lambda x, y, z: world(-x, y, z), place)

    assert wrong_share(image, projection, axes) > 0.2


@pytest.mark.parametrize(("axes", "projection", "world", "place"), PROGRAMS, ids=IDS)
def test_the_colour_check_notices_another_convention(axes, projection, world, place):
    image = drawn(projection, world, place)
    as_ours = axes == "directx" or (axes, projection) == ("nvdiffrec", "lat_long")

    assert (wrong_share(image, projection, "forward") == 0) == as_ours


def test_every_convention_has_its_own_drawing_or_is_that_of_a_strip():
    named = {(axes, projection) for axes, known in _CONVENTIONS.items() for projection in known}

    drawn_here = {(axes, projection) for axes, projection, *_ in PROGRAMS}

    assert {(a, "strip" if p.endswith("cross") else p) for a, p in named} == drawn_here


@pytest.mark.parametrize("axes", ["opengl", "directx", "nvdiffrec"])
@pytest.mark.parametrize("cross", ["vertical_cross", "horizontal_cross"])
def test_a_cross_of_a_programs_cube_is_its_strip_in_other_places(axes, cross):
    light = LIGHTS.create("orientation", {"resolution": 8}).cubemap()

    through_strip, through_cross = (
        to_cubemap(from_cubemap(light, p, axes=axes), p, axes="forward").faces for p in ("strip", cross)
    )

    assert torch.equal(through_strip, through_cross)


@pytest.mark.parametrize(("axes", "projection"), [(a, p) for a, p, *_ in PROGRAMS], ids=IDS)
def test_an_image_for_a_program_comes_back(axes, projection):
    light = LIGHTS.create("gradient", {"resolution": 32}).cubemap()

    back = to_cubemap(from_cubemap(light, projection, axes=axes), projection, axes=axes)

    # Measured 0.016, at the corners of the cube; a strip is copied.
    assert (back.faces - light.faces).abs().max() < (1e-9 if projection == "strip" else 0.03)


@pytest.mark.parametrize("axes", ["blender", "pbrt", "mitsuba"])
def test_a_lat_long_of_any_program_is_turned_not_mirrored(axes):
    matrix = permutation(axes, "lat_long")

    assert torch.linalg.det(matrix) == 1
    assert matrix[1].tolist() == [0, 1, 0]  # up is up


def test_texels_are_moved_whole():
    light = LIGHTS.create("spots", {"resolution": 16}).cubemap()
    matrix = permutation("pbrt", "octahedral_equal_area")

    there = turn_faces(light.faces, matrix)

    d = Vec3(*(c.flatten() for c in texel_directions(16)))
    moved = torch.stack(d, dim=1) @ matrix.T
    nearest = (moved @ torch.stack(d)).argmax(1)
    assert torch.equal(there.reshape(-1, 3), light.faces.reshape(-1, 3)[nearest])
    assert torch.equal(turn_faces(there, matrix.T), light.faces)


def test_the_mitsuba_convention_is_that_of_its_envmap_emitter():
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    height = 128
    v, u = (np.arange(height) + 0.5) / height, (np.arange(2 * height) + 0.5) / (2 * height)
    wave = np.sin(pi * v)[:, None] * np.sin(2 * pi * u + 0.4)[None, :]
    image = np.stack([2 + wave, 2 + np.cos(pi * v)[:, None] + 0 * wave, 2 + wave**3], axis=-1).astype(np.float32)
    emitter = mi.load_dict({"type": "envmap", "bitmap": mi.Bitmap(image)})
    light = to_cubemap(torch.from_numpy(image), "lat_long", 64, axes="mitsuba")
    face, row, column = np.random.default_rng(2).integers(0, (6, 64, 64), (300, 3)).T

    theirs = []
    for d in torch.stack(texel_directions(64), dim=-1)[face, row, column].tolist():
        si = mi.SurfaceInteraction3f()
        si.wi = mi.Vector3f([-c for c in d])
        theirs.append(np.array(emitter.eval(si)))

    difference, mirrored = (
        abs(light_faces[face, row, column].numpy() - np.array(theirs)).max()
        for light_faces in (light.faces, turn_faces(light.faces, torch.diag(torch.tensor([-1.0, 1, 1]))))
    )
    # Measured 0.013 = pi / 2 / 128 and a little: half a row at the poles, and a texel is a mean.
    assert difference < 0.02
    assert mirrored > 0.5


@pytest.mark.parametrize(
    ("axes", "projection", "message"),
    [
        ("opengl", "lat_long", "axes 'opengl' do not apply to the projection lat_long, only to vertical_cross"),
        ("mitsuba", "strip", "axes 'mitsuba' do not apply to the projection strip, only to lat_long"),
        ("bender", "lat_long", "unknown axes 'bender'; did you mean 'blender'"),
    ],
)
def test_axes_that_do_not_apply_are_one_clear_line(axes, projection, message):
    shape = (6, 36, 3) if projection == "strip" else (8, 16, 3)

    with pytest.raises(InputError, match=message):
        to_cubemap(torch.ones(*shape), projection, axes=axes)
    with pytest.raises(InputError, match=message):
        from_cubemap(LIGHTS.create("constant", {}).cubemap(), projection, axes=axes)


def test_a_light_from_a_file_has_its_own_key_for_each_convention(tmp_path):
    write_exr(tmp_path / "a.exr", torch.rand(8, 16, 3))
    readings = [{}, {"axes": "mitsuba"}, {"scale": 2.0}, {"flip_vertical": True}, {"projection": "dual_paraboloid"}]

    lights = [FileLight(file=str(tmp_path / "a.exr"), **reading).cubemap() for reading in readings]

    assert len({light.key for light in lights}) == len(readings)
    assert torch.allclose(lights[2].faces, 2 * lights[0].faces)
    assert not torch.allclose(lights[1].faces, lights[0].faces)
