"""How a file says that it covers the sphere: OpenEXR's `envmap`, what is written here, and what is stated."""

import numpy as np
import OpenEXR
import pytest
import torch

from glossbench.envmap.cubemap import CubeMap, texel_directions
from glossbench.envmap.formats.files import read_file, write_exr
from glossbench.envmap.formats.image_content import Covering
from glossbench.envmap.lights.file_light import FileLight
from glossbench.envmap.projections.axes import _CONVENTIONS
from glossbench.envmap.projections.conversion import from_cubemap, to_cubemap
from glossbench.errors import InputError

CUBE, LAT_LONG = OpenEXR.ENVMAP_CUBE, OpenEXR.ENVMAP_LATLONG


def scene(x, y, z):
    """Radiance that differs in every direction, and from its mirror image."""
    return np.stack([2 + x + 0.3 * y * z, 2 + y + 0.3 * x * z, 2 + z + 0.3 * x * y], -1).astype(np.float32)


def cube_by_the_manual(n):
    """The cube of ImfEnvmap.cpp: each direction of a face goes to pixelPosition() of it, pixel by pixel."""
    at = np.arange(n) / (n - 1) * 2 - 1
    image = np.full((6 * n, n, 3), np.nan, np.float32)
    last = n - 1
    for i, a in enumerate(at):  # position in the face: (i, j), (a, b) from -1 to 1
        for j, b in enumerate(at):
            places = [
                ((1, a, b), (j, last - i)), ((-1, a, b), (last - j, last - i)), ((a, 1, b), (i, last - j)),
                ((a, -1, b), (i, j)), ((a, b, 1), (last - i, last - j)), ((a, b, -1), (i, last - j)),
            ]  # fmt: skip
            for face, (direction, (column, row)) in enumerate(places):
                image[face * n + row, column] = scene(*(np.array(direction) / np.linalg.norm(direction)))
    assert not np.isnan(image).any()
    return image


def lat_long_by_the_manual(n):
    """ImfEnvmap.h: from latitude +pi/2 and longitude +pi to -pi/2 and -pi; longitude 0 is +z, pi/2 is +x."""
    longitude, latitude = np.meshgrid(np.linspace(np.pi, -np.pi, 2 * n), np.linspace(np.pi / 2, -np.pi / 2, n))
    return scene(np.sin(longitude) * np.cos(latitude), np.sin(latitude), np.cos(longitude) * np.cos(latitude))


def write(path, image, **header):
    planes = {c: np.ascontiguousarray(image[..., i]) for i, c in enumerate("RGB")}
    OpenEXR.File({"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION, **header}, planes).write(
        str(path)
    )
    return str(path)


def worst(light):
    """The largest error against the scene at the texels' centres."""
    d = torch.stack(texel_directions(light.resolution)).numpy()
    return np.abs(light.faces.numpy() - scene(*d)).max()


@pytest.mark.parametrize("n", [16, 24])
def test_a_cube_by_openexrs_attribute_has_each_direction_in_its_place(tmp_path, n):
    light = FileLight(file=write(tmp_path / "a.exr", cube_by_the_manual(n), envmap=CUBE), resolution=16)

    # Measured 0.005 and 0.003: linear between the samples, and a texel is a mean.
    assert worst(light.cubemap()) < 0.01
    assert (light.facts().projection, light.facts().axes, light.notes()) == ("openexr_cube", "forward", ())


@pytest.mark.parametrize("fault", ["faces swapped", "a face turned", "samples inside the edges"])
def test_the_check_of_the_cube_notices(tmp_path, fault):
    image = cube_by_the_manual(16)
    if fault == "faces swapped":
        image = np.concatenate([image[:64], image[80:], image[64:80]])
    elif fault == "a face turned":
        image[32:48] = image[32:48][::-1, ::-1]
    projection = "strip" if fault == "samples inside the edges" else "openexr_cube"
    if projection == "strip":
        image = np.concatenate([image[:64], image[80:], image[64:80]])

    assert worst(to_cubemap(torch.from_numpy(image), projection, 16)) > 0.02


def test_a_lat_long_by_openexrs_attribute_has_each_direction_in_its_place(tmp_path):
    path = write(tmp_path / "a.exr", lat_long_by_the_manual(64), envmap=LAT_LONG)
    light = FileLight(file=path, resolution=16)

    # Measured 0.06, half a row at the poles.
    assert worst(light.cubemap()) < 0.08
    assert (light.facts().projection, light.facts().axes) == ("lat_long", "mitsuba")
    assert light.notes() == (
        "a.exr: by its attribute envmap +z is in the centre, -x right of it (axes mitsuba); `axes: forward` wins",
    )
    assert worst(FileLight(file=path, resolution=16, axes="forward").cubemap()) > 1


def test_a_cube_of_one_pixel_a_face_is_six_colours(tmp_path):
    image = np.arange(1, 7, dtype=np.float32).reshape(6, 1, 1).repeat(3, axis=2)

    light = FileLight(file=write(tmp_path / "a.exr", image, envmap=CUBE)).cubemap()

    assert light.faces[:, 0, 0, 0].tolist() == pytest.approx([1, 2, 3, 4, 5, 6], rel=1e-6)


@pytest.mark.parametrize(
    ("shape", "envmap", "said"), [((8, 16, 3), CUBE, "openexr_cube"), ((8, 8, 3), LAT_LONG, "lat_long")]
)
def test_an_attribute_that_does_not_fit_the_picture_is_ignored_with_a_note(tmp_path, shape, envmap, said):
    light = FileLight(file=write(tmp_path / "a.exr", np.ones(shape, np.float32), envmap=envmap))

    assert light.facts().projection == ("lat_long" if shape[1] == 16 else "angular")
    assert light.notes() == (
        f"a.exr: its attribute envmap says {said}, which does not fit {shape[1]} x {shape[0]} pixels: ignored",
    )


def test_a_stated_projection_wins_over_the_attribute_with_a_note(tmp_path):
    light = FileLight(file=write(tmp_path / "a.exr", cube_by_the_manual(8), envmap=CUBE), projection="strip")

    assert light.facts().projection == "strip"
    assert light.notes() == ("a.exr: its attribute envmap says openexr_cube, but it is read as strip, as stated",)


def test_the_attribute_follows_the_part_that_is_read(tmp_path):
    plane = np.ones((12, 2), np.float32)
    made = [OpenEXR.Part({"name": name, **header}, dict.fromkeys("RGB", plane))
            for name, header in (("glow", {}), ("beauty", {"envmap": CUBE}))]  # fmt: skip
    OpenEXR.File(made).write(str(tmp_path / "a.exr"))

    assert read_file(tmp_path / "a.exr").covers == Covering("openexr_cube", "forward", "its attribute envmap")
    assert read_file(tmp_path / "a.exr", "glow").covers is None


# What is written here


WRITTEN = [(projection, axes) for axes, known in _CONVENTIONS.items() for projection in known] + [
    (projection, "forward")
    for projection in ("lat_long", "angular", "vertical_cross", "horizontal_cross", "strip", "dual_paraboloid",
                       "octahedral", "octahedral_equal_area")
]  # fmt: skip


@pytest.fixture(scope="module")
def marked():
    """The scene as a light."""
    return CubeMap(torch.from_numpy(scene(*torch.stack(texel_directions(16)).numpy())))


@pytest.mark.parametrize(("projection", "axes"), WRITTEN)
def test_a_written_light_is_read_back_by_what_it_says(tmp_path, marked, projection, axes):
    image = from_cubemap(marked, projection, axes=axes)
    write_exr(tmp_path / "a.exr", image, covers=Covering(projection, axes))

    light = FileLight(file=str(tmp_path / "a.exr"), resolution=16)

    stated = FileLight(file=str(tmp_path / "a.exr"), resolution=16, projection=projection, axes=axes)
    assert torch.equal(light.cubemap().faces, stated.cubemap().faces)
    assert (light.facts().projection, light.facts().axes, light.notes()) == (projection, axes, ())
    # Measured 0.06, at the poles of a lat_long; crosses and strips are copied.
    assert worst(light.cubemap()) < 0.1


@pytest.mark.parametrize(("projection", "axes"), [("octahedral", "forward"), ("lat_long", "blender")])
def test_the_way_back_without_what_it_says_would_be_noticed(tmp_path, marked, projection, axes):
    write_exr(tmp_path / "a.exr", from_cubemap(marked, projection, axes=axes))

    light = FileLight(file=str(tmp_path / "a.exr"), resolution=16)

    assert worst(light.cubemap()) > 0.5


@pytest.mark.parametrize(
    ("projection", "axes", "envmap"),
    [("lat_long", "mitsuba", LAT_LONG), ("lat_long", "forward", None), ("strip", "forward", None)],
)
def test_openexrs_attribute_is_written_where_it_is_true(tmp_path, marked, projection, axes, envmap):
    write_exr(tmp_path / "a.exr", from_cubemap(marked, projection, axes=axes), covers=Covering(projection, axes))

    with OpenEXR.File(str(tmp_path / "a.exr"), header_only=True) as file:
        header = file.header()
        assert header.get("envmap") == envmap
        assert (header["glossbench:projection"], header["glossbench:axes"]) == (projection, axes)


def test_stated_axes_win_over_those_of_the_file_and_this_is_said(tmp_path, marked):
    write_exr(tmp_path / "a.exr", from_cubemap(marked, "lat_long", axes="pbrt"), covers=Covering("lat_long", "pbrt"))

    light = FileLight(file=str(tmp_path / "a.exr"), resolution=16, axes="blender")

    assert light.facts().axes == "blender"
    assert light.notes() == (
        "a.exr: its attribute glossbench:projection says axes pbrt, but it is read with axes blender, as stated",
    )


@pytest.mark.parametrize("covers", [Covering("globe", "forward"), Covering("strip", "forward")])
def test_what_a_file_cannot_mean_is_left_out_and_this_is_said(tmp_path, covers):
    write_exr(tmp_path / "a.exr", torch.ones(8, 16, 3), covers=covers)

    light = FileLight(file=str(tmp_path / "a.exr"))

    assert light.facts().projection == "lat_long"
    assert light.notes() == (
        f"a.exr: its attribute glossbench:projection says {covers.projection}, which does not fit 16 x 8 pixels: "
        "ignored",
    )


def test_unknown_axes_of_a_file_are_one_clear_line(tmp_path):
    write_exr(tmp_path / "a.exr", torch.ones(8, 16, 3), covers=Covering("lat_long", "north"))

    with pytest.raises(InputError, match="unknown axes 'north'"):
        FileLight(file=str(tmp_path / "a.exr")).cubemap()


def test_openexrs_cube_is_read_and_not_written(marked):
    with pytest.raises(InputError, match="openexr_cube can be read but not written; write one of lat_long, "):
        from_cubemap(marked, "openexr_cube")
