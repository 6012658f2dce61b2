"""glossbench: compare prefiltering methods for glossy image-based lighting against a converged reference.

The same names and options as in a study:

    import glossbench as gb
    light = gb.light("spots", seed=7, resolution=256)
    material = gb.material("kurt", m=[0.2, 0.075])
    view = gb.view("sphere", resolution=128)
    image = gb.shade(gb.method("regular_sampling", samples=17), light, material, view)
    truth = gb.reference(light, material, view, relative_error=1e-2)
    gb.metric("rms")(image, truth)
"""

import os
from pathlib import Path
from typing import Any

# Before torch starts its threads, which on a busy machine would spin while they wait (docs/decisions/006).
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

from glossbench.brdf.material import MATERIALS, Material
from glossbench.envmap.cubemap import CubeMap
from glossbench.envmap.lights import LIGHTS
from glossbench.errors import InputError, MethodError
from glossbench.ground_truth import Reference
from glossbench.ground_truth import compute_reference as reference
from glossbench.metrics import METRICS, Metric
from glossbench.scene.points import VIEWS, View
from glossbench.shading import METHODS, Contract, Image, Method, shade, stage

__all__ = [
    "Contract",
    "CubeMap",
    "Image",
    "InputError",
    "Material",
    "Method",
    "MethodError",
    "Metric",
    "Reference",
    "View",
    "light",
    "material",
    "method",
    "metric",
    "reference",
    "shade",
    "stage",
    "view",
]


def light(name: str, **options: Any) -> CubeMap:
    """The radiance of a light: a registered name ("spots"), or an image file (.hdr, .exr)."""
    if Path(name).suffix and name not in LIGHTS.names():
        return LIGHTS.create("file", {"file": name, **options}).cubemap()
    return LIGHTS.create(name, options).cubemap()


def material(name: str, **options: Any) -> Material:
    """A material by name and options."""
    return MATERIALS.create(name, options)


def view(name: str, **options: Any) -> View:
    """A view by name and options."""
    return VIEWS.create(name, options)


def method(name: str, **options: Any) -> Method:
    """A method by name and options."""
    return METHODS.create(name, options)


def metric(name: str, **options: Any) -> Metric:
    """A metric by name: call it with an image and the truth."""
    return METRICS.create(name, options)
