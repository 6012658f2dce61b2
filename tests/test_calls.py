"""Calls from Python with arguments of a wrong kind: one line that says what to write instead."""

from pathlib import Path

import pytest
import torch

import glossbench as gb
from glossbench.envmap.formats.files import write_exr

LIGHT, MATERIAL, VIEW = gb.light("constant", resolution=8), gb.material("ggx"), gb.view("sphere", resolution=4)
METHOD = gb.method("importance_sampling", samples=2)
IMAGE = gb.shade(METHOD, LIGHT, MATERIAL, VIEW, time_it=False)
TRUTH = gb.reference(LIGHT, MATERIAL, VIEW, relative_error=1.0)
ORDER = "shade(method, light, material, view)"
WRONG = [
    (lambda: gb.shade("many_lights", LIGHT, MATERIAL, VIEW),
     ORDER + ": method must be what gb.method(\"many_lights\") makes, got 'many_lights'"),
    (lambda: gb.shade(METHOD, "spots", MATERIAL, VIEW),
     ORDER + ": light must be what gb.light(\"spots\") makes, got 'spots'"),
    (lambda: gb.shade(METHOD, MATERIAL, LIGHT, VIEW),
     ORDER + ": light must be what gb.light(\"...\") makes, got a GGX"),
    (lambda: gb.shade(METHOD, LIGHT, MATERIAL, 5), ORDER + ": view must be what gb.view(\"...\") makes, got 5"),
    (lambda: gb.reference(LIGHT, MATERIAL, "sphere"),
     "reference(light, material, view): view must be what gb.view(\"sphere\") makes, got 'sphere'"),
    (lambda: gb.light(5), "a light is asked for by its name, such as 'checker', got 5"),
    (lambda: gb.view(LIGHT), "a view is asked for by its name, such as 'mesh', got a CubeMap"),
    (lambda: gb.material(MATERIAL),
     "a material is asked for by its name, such as 'cayman', got a GGX; it is made already: use it as it is"),
    (lambda: gb.metric(None), "a metric is asked for by its name, such as 'flip', got None"),
    (lambda: gb.metric("rms")(TRUTH, IMAGE), "metric(image, truth): the reference comes second, got it first"),
    (lambda: gb.metric("rms")(IMAGE.radiance, TRUTH),
     "metric(image, truth): image must have radiance and mask, got a Tensor"),
    (lambda: gb.metric("rms").error_map(IMAGE, None),
     "metric(image, truth): truth must have radiance and mask, got None"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "message"), WRONG, ids=[message[:40] for _, message in WRONG])
def test_a_wrong_kind_of_argument_is_one_line(call, message):
    with pytest.raises(gb.InputError) as error:
        call()

    assert str(error.value) == message


def test_two_references_compare():
    assert gb.metric("rms")(TRUTH, TRUTH) == 0


def test_a_light_may_be_a_path(tmp_path):
    write_exr(tmp_path / "a.exr", torch.ones(8, 16, 3))

    assert gb.light(Path(tmp_path / "a.exr"), resolution=4).faces.mean() == pytest.approx(1)
