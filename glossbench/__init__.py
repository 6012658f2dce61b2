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
from importlib import import_module
from typing import TYPE_CHECKING, Any

# This must be set before torch starts its threads: on a busy machine they would spin while they wait
# (docs/decisions/006).
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
# And this before torch's first tensor: to touch new memory page by page takes three times as long as to fill it
# (docs/decisions/006).
os.environ.setdefault("THP_MEM_ALLOC_ENABLE", "1")

if TYPE_CHECKING:
    from glossbench.brdf.material import Material
    from glossbench.envmap.cubemap import CubeMap
    from glossbench.errors import InputError, MethodError
    from glossbench.metrics import Metric
    from glossbench.scene.points import View
    from glossbench.shading.image import Image, shade
    from glossbench.shading.method import Contract, Method, stage
    from glossbench.truth.reference import Reference
    from glossbench.truth.reference import compute_reference as reference

# The module of each name. It is imported at the first use of the name: torch takes seconds to import, and completion of
# a command line by the Tab key must not wait for it.
_HOMES = {
    "Material": ("brdf.material", "Material"),
    "CubeMap": ("envmap.cubemap", "CubeMap"),
    "InputError": ("errors", "InputError"),
    "MethodError": ("errors", "MethodError"),
    "Reference": ("truth.reference", "Reference"),
    "reference": ("truth.reference", "compute_reference"),
    "Metric": ("metrics", "Metric"),
    "View": ("scene.points", "View"),
    **{name: ("shading.image", name) for name in ("Image", "shade")},
    **{name: ("shading.method", name) for name in ("Contract", "Method", "stage")},
}

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


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, attribute = _HOMES[name]
    value = globals()[name] = getattr(import_module(f"{__name__}.{module}"), attribute)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def light(name: str | os.PathLike[str], **options: Any) -> "CubeMap":
    """The radiance of a light: a registered name ("spots"), a catalogue name ("grace_cross") or an image file."""
    from glossbench.envmap.lights.file_light import make_light
    from glossbench.envmap.lights.light import LIGHTS
    from glossbench.process.surroundings import settled

    with settled():
        text = _text(name)
        # A value that is not text cannot be a name: the registry refuses it.
        return (make_light(text, options) if isinstance(text, str) else LIGHTS.create(text, options)).cubemap()


def material(name: str | os.PathLike[str], **options: Any) -> "Material":
    """A material by name and options, or by file: a measurement (.brdf, .binary, .bsdf) or a table of fits (.fit)."""
    from glossbench.brdf.material import MATERIALS
    from glossbench.brdf.measured_file import resolve_material

    text = _text(name)
    text, stated = resolve_material(text) if isinstance(text, str) else (text, {})
    return MATERIALS.create(text, {**stated, **options})


def view(name: str | os.PathLike[str], **options: Any) -> "View":
    """A view by name and options, or by mesh file."""
    from glossbench.scene.mesh_view import resolve_view
    from glossbench.scene.points import VIEWS

    text = _text(name)
    text, stated = resolve_view(text) if isinstance(text, str) else (text, {})
    return VIEWS.create(text, {**stated, **options})


def _text(name: str | os.PathLike[str]) -> str:
    return os.fspath(name) if isinstance(name, os.PathLike) else name


def method(name: str, **options: Any) -> "Method":
    """A method by name and options."""
    from glossbench.shading.method import METHODS

    return METHODS.create(name, options)


def metric(name: str, **options: Any) -> "Metric":
    """A metric by name: call it with an image and the truth."""
    from glossbench.metrics import METRICS

    return METRICS.create(name, options)
