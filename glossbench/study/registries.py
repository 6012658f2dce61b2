"""The registries of methods, materials, lights, views and metrics, by kind."""

from collections.abc import Mapping
from typing import Any

from glossbench.brdf.material import MATERIALS
from glossbench.envmap.lights.light import LIGHTS
from glossbench.metrics import METRICS
from glossbench.registry import Registry
from glossbench.scene.points import VIEWS
from glossbench.shading.method import METHODS

REGISTRIES: Mapping[str, Registry[Any]] = {
    "method": METHODS, "material": MATERIALS, "light": LIGHTS, "view": VIEWS, "metric": METRICS
}  # fmt: skip
