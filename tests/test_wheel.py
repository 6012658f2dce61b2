"""What is installed from a built wheel, without the source tree."""

import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from zipfile import ZipFile

import pytest

pytestmark = pytest.mark.slow
ROOT = Path(__file__).resolve().parents[1]
PLUGIN = """
from typing import Annotated

import torch
from pydantic import Field

from glossbench.prefilter import METHODS, CubeMap, Material, Method, Radiance, ShadingPoints, stage


@METHODS.register("flat_light")
class FlatLight(Method):
    gain: Annotated[float, Field(ge=0)] = 1.0

    @stage
    def mean(self, light: CubeMap) -> torch.Tensor:
        return light.mean().float() * self.gain

    def shade(self, points: ShadingPoints, material: Material, mean: torch.Tensor) -> Radiance:
        return mean.expand(len(points), 3).clone()
"""
FAULTS = """

FlatLight(gain="much")
FlatLight.mean.function(FlatLight(), 1) + "text"
Material().no_such_name
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """A wheel, built from a copy of the tree, so that the tree keeps no trace of it."""
    copy = tmp_path_factory.mktemp("tree")
    for name in ("glossbench", "methods", "reports", "studies", "data"):
        shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, copy)
    build = "from setuptools.build_meta import build_wheel; build_wheel('dist')"
    subprocess.run([sys.executable, "-c", build], cwd=copy, check=True, capture_output=True)
    [built] = (copy / "dist").glob("*.whl")
    return built


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """The folder into which the wheel is installed."""
    target = tmp_path_factory.mktemp("installed")
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", str(target), str(wheel)]
    subprocess.run(pip, check=True, capture_output=True)
    return target


def run(installed, folder, *command):
    """A Python command in a folder outside of the tree, with the installed package before all others."""
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    return subprocess.run(
        [sys.executable, *command], cwd=folder, env=environment, capture_output=True, text=True, timeout=300
    )


def test_the_wheel_holds_every_file_of_the_tree(wheel):
    places = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-dir"]
    wanted = {
        f"{package.replace('.', '/')}/{path.relative_to(ROOT / folder)}"
        for package, folder in places.items()
        for path in (ROOT / folder).rglob("*")
        if path.is_file() and path.suffix != ".pyc"
    }

    held = {name for name in ZipFile(wheel).namelist() if ".dist-info/" not in name}

    assert held == wanted


def test_the_installed_package_validates_a_study_outside_of_the_tree(installed, tmp_path):
    code = "import runpy, glossbench; print(glossbench.__file__); runpy.run_module('glossbench', run_name='__main__')"

    done = run(installed, tmp_path, "-c", code, "validate", "quickstart")

    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(str(installed))
    assert "Filtering the light lowers the error of importance sampling" in done.stdout


def test_types_reach_a_plugin_that_is_checked_strictly(installed, tmp_path):
    (tmp_path / "sound.py").write_text(PLUGIN)
    (tmp_path / "faulty.py").write_text(PLUGIN + FAULTS)

    done = run(installed, tmp_path, "-m", "mypy", "--strict", "--no-pretty", "sound.py", "faulty.py")

    faults = [line.rsplit("[", 1)[1].rstrip("]") for line in done.stdout.splitlines() if line.startswith("faulty.py")]
    assert "sound.py" not in done.stdout
    assert faults == ["arg-type", "operator", "attr-defined"]
