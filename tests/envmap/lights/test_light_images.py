"""Images as lights: shapes that are nearly right, sizes that are odd, and pixels that are not radiance."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from glossbench.commands.light import light as light_command
from glossbench.directions import vec3
from glossbench.envmap.formats.files import write_exr
from glossbench.envmap.lights.file_light import FileLight
from glossbench.envmap.projections import resampling
from glossbench.envmap.projections.conversion import guess_projection, to_cubemap
from glossbench.errors import InputError
from glossbench.run.runner import run_study
from glossbench.study.study import load_study


def sky(height, width):
    """Radiance 1 + the components of the direction, of latitude and longitude; mean 1."""
    v, u = torch.meshgrid(
        (torch.arange(height) + 0.5) / height * np.pi,
        ((torch.arange(width) + 0.5) / width * 2 - 1) * np.pi,
        indexing="ij",
    )
    return torch.stack([1 + v.sin() * u.sin(), 1 + v.cos(), 1 - v.sin() * u.cos()], dim=2)


@pytest.mark.parametrize("shape", [(511, 1023), (512, 1023), (33, 64), (32, 65), (938, 1917)])
def test_an_image_of_nearly_two_to_one_is_latitude_and_longitude(shape):
    assert guess_projection(*shape) == "lat_long"
    normals = torch.eye(3)

    light = to_cubemap(sky(*shape), resolution=16)

    irradiance = light.irradiance(vec3(normals))
    assert irradiance / np.pi == pytest.approx((torch.ones(3, 3) + normals * 2 / 3).numpy(), rel=0.01)


@pytest.mark.parametrize("shape", [(50, 94), (50, 106), (50, 80)])
def test_what_is_further_from_two_to_one_is_refused_unless_it_is_stated(shape):
    with pytest.raises(InputError, match="no known projection"):
        to_cubemap(sky(*shape))

    assert to_cubemap(sky(*shape), "lat_long", 16).mean().numpy() == pytest.approx(1, rel=0.01)


def test_the_note_on_the_shape_names_the_file_and_the_size(tmp_path):
    write_exr(tmp_path / "odd.exr", sky(31, 63))
    write_exr(tmp_path / "even.exr", sky(32, 64))

    notes = [FileLight(file=str(tmp_path / name)).notes() for name in ("odd.exr", "even.exr")]

    assert notes == [("odd.exr: taken as lat_long, though 63 x 31 pixels are not 2 : 1",), ()]


@pytest.mark.parametrize(
    ("shape", "projection"),
    [((65, 130), "lat_long"), ((65, 131), "lat_long"), ((65, 130), "dual_paraboloid"), ((129, 129), "angular"),
     ((4 * 33, 3 * 33), "vertical_cross")],
)  # fmt: skip
def test_odd_sizes_are_averaged_first_as_even_ones_are(monkeypatch, shape, projection):
    taken = []
    to_faces = resampling.to_faces
    monkeypatch.setattr(
        "glossbench.envmap.projections.conversion.to_faces", lambda *a: taken.append(a[2]) or to_faces(*a)
    )
    monkeypatch.setattr(resampling, "to_faces", lambda *a: taken.append(a[2]) or to_faces(*a))

    light = to_cubemap(torch.ones(*shape, 3), projection, 2)

    assert all(resolved <= 4.2 for resolved in taken)
    assert light.faces.numpy() == pytest.approx(1, abs=1e-5)


def test_halving_an_odd_size_keeps_the_sum_of_each_pixel_by_its_share():
    image = torch.tensor([1.0, 2, 4, 8, 16])[None, None, :, None].expand(1, 2, -1, 3)

    half = resampling.halve_images(image, torch.ones(2, 5))

    # Bins of two and a half pixels.
    assert half[0, 0, :, 0].tolist() == pytest.approx([(1 + 2 + 4 / 2) / 2.5, (4 / 2 + 8 + 16) / 2.5])


def test_the_check_of_halving_notices_pixels_that_count_twice():
    image = torch.tensor([1.0, 2, 4, 8, 16]).expand(1, 3, 1, 5)

    pooled = torch.nn.functional.adaptive_avg_pool2d(image, (1, 2))

    assert pooled[0, 0, 0].tolist() != pytest.approx([2.0, 10.4], rel=0.1)


def spoilt(path, *values):
    """A light of 2 with these values one after another in the green of its second row."""
    image = torch.full((8, 16, 3), 2.0)
    image[0, 0] = 7
    for column, value in enumerate(values):
        image[1, column, 1] = value
    write_exr(path, image)
    return str(path)


BAD = (float("nan"), -1.0, float("inf"), 3e38, -float("inf"))


@pytest.mark.parametrize(
    ("value", "rule"), [(3e38, "at most 1e\\+30"), (float("inf"), "finite"), (-0.5, "not negative")]
)
def test_a_pixel_that_is_not_radiance_names_its_file_its_place_and_the_option(tmp_path, value, rule):
    file = spoilt(tmp_path / "a.exr", 1, value, value)
    match = rf"a.exr: radiance must be {rule}, but 2 pixels are not, first at row 1, column 1: {value:.0g}"

    with pytest.raises(InputError, match=f"{match.replace('e+', 'e.')}.*; invalid: clamp lets them in"):
        FileLight(file=file).cubemap()


def test_clamped_pixels_are_changed_counted_and_noted(tmp_path):
    light = FileLight(file=spoilt(tmp_path / "a.exr", *BAD), invalid="clamp")

    assert light.image()[1, :6, 1].tolist() == [0, 0, 7, 7, 0, 2]
    assert light.notes() == (
        "a.exr: invalid values of 5 of 128 pixels set: 1 NaN to 0, 2 negative to 0, 2 too large to 7",
    )
    assert light.cubemap().faces.max() <= 7


def test_the_scale_counts_before_a_pixel_is_judged(tmp_path):
    file = spoilt(tmp_path / "a.exr", 3e38)

    assert FileLight(file=file, scale=1e-9).image().max() == pytest.approx(3e29)
    with pytest.raises(InputError, match=r"a.exr: radiance must be at most"):
        FileLight(file=spoilt(tmp_path / "a.exr", 3e20), scale=1e12).cubemap()


def test_an_image_without_a_valid_pixel_is_black_when_clamped(tmp_path):
    write_exr(tmp_path / "a.exr", torch.full((8, 16, 3), float("nan")))

    assert FileLight(file=str(tmp_path / "a.exr"), invalid="clamp").cubemap().faces.max() == 0


def test_notes_of_a_light_stand_in_every_row_of_a_run_and_in_what_light_prints(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    spoilt(tmp_path / "a.exr", -1.0)
    Path("s.yaml").write_text(
        "title: T\nlight: {file: a.exr, invalid: clamp, resolution: 8}\nmaterial: {ggx: {alpha: 0.5}}\n"
        "view: {sphere: {resolution: 4}}\nmethods: {importance_sampling: {samples: 1}}\n"
        "reference: {relative_error: 0.3}\n"
    )
    note = "a.exr: invalid values of 1 of 128 pixels set: 1 negative to 0"

    cells = run_study(load_study(Path("s.yaml")), Path("out")).cells
    light_command("a.exr", invalid="clamp")

    assert [json.loads(notes) for notes in cells["notes"]] == [[note]]
    assert note in capsys.readouterr().out
