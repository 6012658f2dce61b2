"""The command light: what it understood of a file, other projections, pictures."""

import os
import subprocess
from pathlib import Path

import pytest
import torch
from matplotlib.image import imread

from glossbench.commands.picture import to_half_blocks, tone_map
from glossbench.envmap.formats.files import read_image, write_exr
from glossbench.envmap.lights.file_light import make_light
from oracles.command_line import process, words

pytestmark = pytest.mark.usefixtures("here")


# Of the mean of a light written and read again. Measured 2.6e-4 as an angular map, 4e-8 or less as all else; an
# octahedral one that is read as an angular one is 0.5 off.
ENERGY = 1e-3


def test_light_says_what_it_understood(call):
    write_exr("probe.exr", torch.full((8, 16, 3), 2.0))

    code, out, err = call("light", "probe.exr")

    # A constant light: mean and peak are its radiance, irradiance pi times as much.
    said = {line[:19].strip(): words(line[19:]) for line in out.splitlines()}
    assert (code, err) == (0, "")
    assert said["read as"] == "lat_long, 16 x 8 pixels"
    assert said["cube map"] == "6 faces of 4 x 4 texels"
    assert said["mean radiance"] == "2 2 2"
    assert said["peak luminance"] == "2 (brightest pixel of the file: 2)"
    assert said["dynamic range"] == "1 : 1"
    assert said["brightest 0.1 %"] == "0.1 % of the energy"
    for side in ("up", "right", "forward"):
        # Measured 6.418 for 2 pi = 6.283, 2.1 %: the midpoint rule of sixteen texels a face.
        assert [float(c) for c in said[f"irradiance {side}"].split()] == pytest.approx([6.2832] * 3, rel=0.03)


def test_light_takes_the_name_of_an_embedded_light(call):
    code, out, err = call("light", "constant", "--resolution", 8)

    assert (code, err) == (0, "")
    assert "6 faces of 8 x 8 texels" in out
    assert "read as" not in out


def test_light_takes_the_options_of_a_file(call):
    image = torch.zeros(8, 16, 3)
    image[:2] = 1.0
    write_exr("probe.exr", image)

    upright, flipped = (call("light", "probe.exr", "--resolution", 4, *flag).out for flag in ([], ["--flip"]))

    up = [float(next(line for line in out.splitlines() if line.startswith("irradiance up")).split()[2])
          for out in (upright, flipped)]  # fmt: skip
    assert up[0] > 1
    assert up[1] == 0


@pytest.mark.parametrize(
    ("projection", "shape"),
    [
        ("cross", (64, 48)), ("vertical_cross", (64, 48)), ("horizontal_cross", (48, 64)), ("lat_long", (32, 64)),
        ("angular", (64, 64)), ("strip", (16, 96)), ("dual_paraboloid", (32, 64)), ("octahedral", (32, 32)),
        ("octahedral_equal_area", (32, 32)),
    ],
)  # fmt: skip
def test_a_light_is_written_in_another_projection_with_its_energy(call, projection, shape):
    code, out, err = call("light", "gradient", "--resolution", 16, "-o", "out.exr", "--as", projection)

    full = {"cross": "vertical_cross"}.get(projection, projection)
    assert (code, err) == (0, "")
    assert out.splitlines()[-1] == f"{full}: out.exr"
    assert tuple(read_image("out.exr").shape[:2]) == shape
    again = make_light("out.exr", {"projection": full, "resolution": 16}).cubemap()
    # The mean of 1 + d_c over 2 is 1 / 2 in each channel.
    assert again.mean().tolist() == pytest.approx([0.5] * 3, rel=ENERGY)


def test_a_light_read_as_another_projection_would_be_noticed(call):
    """Twin of the above."""
    call("light", "gradient", "--resolution", 16, "-o", "out.exr", "--as", "octahedral")

    again = make_light("out.exr", {"projection": "angular", "resolution": 16}).cubemap()

    assert again.mean().tolist() != pytest.approx([0.5] * 3, rel=ENERGY)


def test_a_written_light_is_read_by_what_it_says_of_itself(call):
    call("light", "gradient", "--resolution", 16, "-o", "out.exr", "--as", "octahedral")

    code, out, _ = call("light", "out.exr")

    said = {line[:19].strip(): words(line[19:]) for line in out.splitlines()}
    assert (code, said["read as"]) == (0, "octahedral, 32 x 32 pixels")
    assert [float(c) for c in said["mean radiance"].split()] == pytest.approx([0.5] * 3, rel=ENERGY)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["-o", "out.png"], "out.png: the extension must be .exr, got '.png'"),
        (["-o", "gone/out.exr"], "gone/out.exr: cannot be written: No such file or directory"),
        (["-o", "folder.exr"], "folder.exr: must be a file, but is a folder"),
        (["-o", "out.exr", "--as", "octahedron"], "unknown projection 'octahedron'; did you mean 'octahedral'?"),
        (["-o", "out.exr", "--as-axes", "pbrt", "--as", "strip"], "axes 'pbrt' do not apply to the projection strip"),
    ],
)  # fmt: skip
def test_a_light_that_cannot_be_written_is_refused_before_it_is_made(call, monkeypatch, options, message):
    Path("folder.exr").mkdir()
    monkeypatch.setattr("glossbench.envmap.lights.file_light.make_light", lambda *_: pytest.fail("the light was made"))

    code, _, err = call("light", "gradient", *options)

    assert (code, err.count("\n")) == (2, 1)
    assert err.startswith(f"error: {message}")
    assert not Path("out.exr").exists()


def test_light_takes_the_layer_that_is_named_and_says_what_it_chose(call):
    names = [f"{layer}.{c}" for layer in ("AO", "Combined") for c in "RGB"]
    write_exr("probe.exr", torch.tensor([1.0, 1, 1, 2, 2, 2]).expand(8, 16, 6), names)

    of_itself, named = call("light", "probe.exr"), call("light", "probe.exr", "--layer", "AO")

    mean = [
        next(line for line in run.out.splitlines() if line.startswith("mean")).split()[2] for run in (of_itself, named)
    ]
    assert mean == ["2", "1"]
    assert "probe.exr: the layer Combined is read, one of AO, Combined" in of_itself.out
    assert "is read" not in named.out


def test_a_picture_is_written_whole_or_not_at_all(call):
    before = {"tiny.yaml"}

    written = call("light", "gradient", "--png", "a.png")
    refused = call("light", "gradient", "--png", "a.jpg")
    homeless = call("light", "gradient", "--png", "gone/a.png")

    assert (written.code, written.out.splitlines()[-1]) == (0, "picture: a.png")
    assert refused.code == homeless.code == 2
    assert refused.err == "error: a.jpg: the extension must be .png, got '.jpg'\n"
    assert homeless.err == "error: gone/a.png: cannot be written: No such file or directory\n"
    assert {path.name for path in Path().iterdir()} == before | {"a.png"}


def test_a_picture_shows_up_above_and_right_on_the_right(call):
    call("light", "orientation", "--png", "a.png")

    picture = imread("a.png")[..., :3]
    # Colours of the faces (ORIENTATION_COLORS): at the top +y green, at the bottom -y magenta; along the horizon -z
    # yellow in the centre, +x red at three quarters, -x cyan at one quarter, +z blue at the edges.
    places = [(10, 512), (501, 512), (256, 512), (256, 768), (256, 256), (256, 10)]
    lit = [tuple(bool(c > 0.2) for c in picture[row, column]) for row, column in places]
    wanted = [(0, 1, 0), (1, 0, 1), (1, 1, 0), (1, 0, 0), (0, 1, 1), (0, 0, 1)]
    assert lit == [tuple(bool(c) for c in color) for color in wanted]


def test_a_tone_mapped_grey_of_the_geometric_mean_is_the_published_one():
    pixels = tone_map(torch.full((2, 2, 3), 7.0))

    # Reinhard et al. 2002: x = 0.18, x / (1 + x) = 0.15254; sRGB of it, 1.055 * 0.15254^(1 / 2.4) - 0.055 = 0.4275.
    assert pixels.unique().tolist() == [round(255 * 0.4275)]


def test_a_black_light_is_a_black_picture():
    assert tone_map(torch.zeros(2, 2, 3)).unique().tolist() == [0]


def test_half_blocks_show_two_pixels_a_character():
    pixels = torch.tensor([[[255, 0, 0], [1, 2, 3]], [[0, 255, 0], [4, 5, 6]], [[9, 9, 9], [9, 9, 9]]])

    drawn = to_half_blocks(pixels.to(torch.uint8))

    # The third row has none below it.
    assert drawn.plain == "▀▀\n"
    assert [str(span.style) for span in drawn.spans] == [
        "rgb(255,0,0) on rgb(0,255,0)", "rgb(1,2,3) on rgb(4,5,6)",
    ]  # fmt: skip


def test_a_terminal_is_drawn_on_and_a_pipe_is_not(call):
    environment = {**os.environ, "FORCE_COLOR": "1", "COLORTERM": "truecolor", "COLUMNS": "40"}

    terminal = subprocess.run(process("light", "gradient"), capture_output=True, text=True, env=environment)
    pipe = call("light", "gradient")

    assert (terminal.returncode, terminal.stderr) == (pipe.code, pipe.err) == (0, "")
    assert "▀" not in pipe.out
    assert terminal.stdout.count("▀") == 40 * 10
    assert "\x1b[38;2;" in terminal.stdout


def test_a_run_takes_the_name_of_a_light(call):
    code, out, err = call("run", "tiny.yaml", "--light", "constant", "--dry-run")

    assert (code, err) == (0, "")
    assert all(line.startswith("new  constant  ") for line in out.splitlines()[:-2])
    assert out.splitlines()[-2] == "4 cells would go to results/tiny_constant: 4 new"


def test_a_run_takes_a_name_of_the_catalogue_and_fetches_nothing_before_it_starts(call, here):
    code, out, err = call("run", "tiny.yaml", "--light", "grace_cross", "--dry-run")

    assert (code, err) == (0, "")
    assert out.splitlines()[-2] == "4 cells would go to results/tiny_grace_cross: 4 new"
    assert not (here / "no cache").exists()
