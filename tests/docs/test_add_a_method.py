"""The document on adding a method is right: its code is run unchanged."""

import re
import sys
import tomllib
from importlib.metadata import entry_points
from pathlib import Path

import pytest

import glossbench as gb
from glossbench.contract.method_check import CHECKS, check_contract, check_furnace
from glossbench.registry import Registry
from glossbench.shading.method import METHODS
from glossbench.study.study import load_study

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "add-a-method.md"
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```$", DOCUMENT.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def blocks(language):
    return [code for tag, code in BLOCKS if tag == language]


@pytest.fixture
def lab(tmp_path, monkeypatch):
    """A package my_lab with the document's module; what it registers is forgotten after the test."""
    package = tmp_path / "my_lab"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "single_lookup.py").write_text(blocks("python")[0], encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    with METHODS.isolated():
        yield tmp_path
    for name in ("my_lab", "my_lab.single_lookup"):
        sys.modules.pop(name, None)


def test_the_example_is_under_40_lines_of_code():
    lines = [line for line in blocks("python")[0].splitlines() if line.strip()]

    assert len(lines) < 40


def test_the_script_shades_and_measures(lab, capsys):
    script = blocks("python")[1]

    exec(compile(script, "add-a-method.md", "exec"), {})

    error, updates = capsys.readouterr().out.split(" ", 1)
    # Measured 0.67; four levels too blurred, the light is its mean and the error 0.83.
    assert 0 < float(error) < 0.8
    assert "'view': 0" in updates


def test_the_method_keeps_what_it_claims(lab):
    outcomes = check_contract("my_lab.single_lookup")

    assert len(outcomes) == len(CHECKS)
    assert {o.check for o in outcomes if o.kept is not True} == {"converges"}, outcomes
    assert all(o.kept is not False for o in outcomes), outcomes


def test_the_promised_furnace_is_near_what_is_measured(lab):
    outcome = check_furnace(_example())

    # A bound ten times the error would hide a fault that the check is there to find.
    assert float(outcome.measured.split()[0]) > _example().contract.furnace / 10


def test_without_its_albedo_the_example_breaks_its_claim(lab):
    class NoAlbedo(type(_example())):
        def shade(self, points, material, pyramid, irradiance, albedo):
            return super().shade(points, material, pyramid, irradiance, albedo * 0 + 1)

    assert check_furnace(NoAlbedo()).kept is False


def test_a_lobe_matched_level_beats_the_mirror_and_the_mean(lab):
    light = gb.light("spots", seed=7, resolution=64)
    material, view = gb.material("kurt", m=0.3), gb.view("sphere", resolution=24)
    truth = gb.reference(light, material, view, relative_error=1e-2)

    errors = {
        bias: gb.metric("rms")(
            gb.shade(gb.method(_example().name, mip_bias=bias), light, material, view, time_it=False), truth
        )
        for bias in (-4.0, 0.0, 4.0)
    }

    assert errors[0.0] < errors[-4.0]
    assert errors[0.0] < errors[4.0]


def test_an_anisotropic_material_is_refused_with_the_sentence(lab):
    with pytest.raises(gb.InputError, match="its albedo table is that of a single isotropic lobe"):
        gb.shade(
            _example(),
            gb.light("constant"),
            gb.material("ggx", alpha=[0.1, 0.2]),
            gb.view("sphere", resolution=4),
        )


def test_the_study_loads_with_its_plugin(lab):
    study_file = lab / "my_study.yaml"
    study_file.write_text(blocks("yaml")[0], encoding="utf-8")

    study = load_study(study_file)

    assert study.plugins == ("my_lab.single_lookup",)
    assert {method.name for method in study.methods} == {"single_lookup", "filtered_importance_sampling"}
    assert len(study.claims) == 1


def test_an_installed_package_is_found_by_its_entry_point(lab):
    project = tomllib.loads(blocks("toml")[0])
    groups = project["project"]["entry-points"]
    metadata = lab / "my_lab-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: my-lab\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(
        "".join(f"[{g}]\n" + "".join(f"{k} = {v}\n" for k, v in points.items()) for g, points in groups.items())
    )

    Registry("method", "glossbench.methods", "glossbench.methods").names()

    assert "single_lookup" in entry_points(group="glossbench.methods").names
    assert "my_lab.single_lookup" in sys.modules
    assert "single_lookup" in METHODS.names()


def test_the_document_names_every_check():
    rows = re.findall(r"^\| ([a-z ]+) \|", DOCUMENT.read_text(encoding="utf-8"), re.MULTILINE)

    names = [check(None).check for check in CHECKS]

    assert rows == ["check", *names]


def _example():
    if "my_lab.single_lookup" not in sys.modules:
        __import__("my_lab.single_lookup")
    return METHODS.create("single_lookup", {})
