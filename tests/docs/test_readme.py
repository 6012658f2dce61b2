import re
from pathlib import Path

import pytest
import torch

import glossbench as gb
from glossbench.contract.method_check import check_contract
from glossbench.envmap.formats.files import write_exr
from glossbench.study.study import load_study

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", README, re.DOTALL)


def test_python_road_of_the_readme_gives_a_number_above_the_references_noise(capsys):
    (road,) = [block for block in BLOCKS if "gb.light" in block]

    exec(compile(road, "README.md", "exec"), {})

    rms, noise, *_ = re.findall(r"[\d.]+(?:e-?\d+)?", capsys.readouterr().out)
    assert float(rms) > 2 * float(noise) > 0


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory):
    """What the contract's checks say of the README's method, by check."""
    folder = tmp_path_factory.mktemp("readme")
    (code,) = [block for block in BLOCKS if "METHODS.register" in block]
    (folder / "readme_mirror_blur.py").write_text(code)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        yield {outcome.check: outcome for outcome in check_contract("readme_mirror_blur")}


def test_method_of_the_readme_is_finite_linear_and_pure(outcomes):
    for check in ("finite on hard inputs", "linear in the light", "pure", "same for any chunking"):
        assert outcomes[check].kept, outcomes[check]


@pytest.mark.usefixtures("outcomes")
def test_method_of_the_readme_shows_a_constant_light_as_it_is():
    light, material, view = gb.light("constant", radiance=2.5), gb.material("kurt"), gb.view("sphere", resolution=8)

    image = gb.shade(gb.method("mirror_blur"), light, material, view)

    torch.testing.assert_close(image.radiance[image.mask], torch.full((int(image.mask.sum()), 3), 2.5))


def test_study_of_the_readme_makes_the_cells_that_it_says(tmp_path):
    [study] = re.findall(r"```yaml\n(.*?)```", README, re.DOTALL)
    write_exr(tmp_path / "probe.exr", torch.ones(8, 16, 3))
    (tmp_path / "my_study.yaml").write_text(study.replace("probe.hdr", "probe.exr"))

    cells = load_study(tmp_path / "my_study.yaml").cells()

    assert len(cells) == 2 * 3 * 2 * 3
