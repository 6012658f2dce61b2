"""Anisotropic materials among the conditions of results."""

import json
from functools import cache

from glossbench.brdf.material import MATERIALS
from glossbench.brdf.measured_file import MeasuredMaterial
from glossbench.columns import CONDITIONS
from glossbench.findings.trials import Condition
from glossbench.prefilter.lighting_function import anisotropy


def is_anisotropic(condition: Condition) -> bool:
    """Whether the BRDF of a condition's material changes if both directions turn about the normal.

    Measurements are of isotropic materials in all formats that are read; their files, which may not be here, are not
    opened.

    Raises:
        InputError: the material is not installed here, or another file of it is missing.
    """
    return _is_anisotropic(condition.keys[CONDITIONS.index("material")])


@cache
def _is_anisotropic(material: str) -> bool:
    name, options = json.loads(material)
    if issubclass(MATERIALS.get(name), MeasuredMaterial):
        return False
    return anisotropy(MATERIALS.create(name, options)) is not None
