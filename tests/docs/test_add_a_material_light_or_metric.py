"""The document on adding a material, a light or a metric is right: its code is run unchanged."""

import importlib
import re
import sys
from math import pi
from pathlib import Path

import pytest
import torch

import glossbench as gb
from glossbench.brdf.material import MATERIALS
from glossbench.envmap.lights.light import LIGHTS
from glossbench.metrics import METRICS
from glossbench.shading.image import Image

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "add-a-material-light-or-metric.md"
BLOCKS = re.findall(r"```python\n(.*?)```", DOCUMENT.read_text(encoding="utf-8"), re.DOTALL)


@pytest.fixture(autouse=True)
def printed(tmp_path, monkeypatch, capsys):
    """What the document's module prints; what it registers is forgotten after the test."""
    (tmp_path / "my_plugins.py").write_text("\n".join(BLOCKS), encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "my_plugins", raising=False)
    with MATERIALS.isolated(), LIGHTS.isolated(), METRICS.isolated():
        importlib.import_module("my_plugins")
        yield capsys.readouterr().out


def test_the_materials_sampler_agrees_with_a_sum_that_does_not_use_it(printed):
    summed, sampled, density = (
        torch.tensor([float(n) for n in row.split(",")]) for row in re.findall(r"tensor\(\[(.*?)\]", printed)
    )

    # Measured 1e-4, the four digits that are printed.
    assert torch.allclose(summed, sampled, atol=5e-4, rtol=0)
    assert (density < 1.001).all()


def test_the_unfiltered_methods_agree_with_the_reference_on_the_material_under_the_light():
    light = gb.light("ring", resolution=16)
    material = gb.material("kelemen", m=0.3)
    view = gb.view("sphere", resolution=8)

    truth = gb.reference(light, material, view, relative_error=2e-3)
    methods = [gb.method("importance_sampling", samples=1024), gb.method("environment_sampling", samples=4096)]
    images = [gb.shade(method, light, material, view, time_it=False) for method in methods]

    # Measured 0.009 and 0.008; a density wrong by a factor would move the reference by tenths.
    assert max(gb.metric("relative_rms")(image, truth) for image in images) < 0.02


def test_the_lights_mean_is_that_of_its_formula():
    light = gb.light("ring", radiance=1.0, width=0.5, resolution=64)

    # The mean over the sphere of a function of y alone is the integral over y from 0 to 1: sqrt(pi) w erf(1 / w) / 2.
    expected = pi**0.5 * 0.25 * torch.erf(torch.tensor(2.0)).item()
    assert light.mean()[0].item() == pytest.approx(expected, rel=1e-3)


def test_the_metric_of_a_uniform_error_is_that_error():
    mask = torch.ones(4, 4, dtype=torch.bool)
    image, truth = (Image(torch.full((4, 4, 3), value), mask) for value in (3.0, 1.0))

    assert gb.metric("log_rms")(image, truth) == pytest.approx(torch.tensor(2.0).log().item())
