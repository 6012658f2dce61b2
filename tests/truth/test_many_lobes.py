"""The reference has a kernel for each lobe of a material, up to a limit that it states."""

from dataclasses import replace

import pytest

from glossbench.brdf.kurt import Kurt
from glossbench.brdf.material import MAX_LOBES
from glossbench.envmap.lights.synthetic import Constant
from glossbench.errors import MethodError
from glossbench.scene.sphere import Sphere
from glossbench.truth.reference import compute_reference

LIGHT, VIEW = Constant(resolution=4).cubemap(), Sphere(resolution=2)


class ManyLobes(Kurt):
    """A plug-in's material that no option bounds: the lobe of Kurt, shared among n equal lobes."""

    n: int = 1

    def reflectance(self, device="cpu"):
        one = super().reflectance(device)
        lobe = replace(one.lobes[0], ks=tuple(c / self.n for c in one.lobes[0].ks))
        return replace(one, lobes=(lobe,) * self.n)


ManyLobes.name = "many_lobes"


def test_more_lobes_than_that_are_the_materials_fault():
    with pytest.raises(MethodError, match=r"many_lobes\.reflectance must have at most 16 lobes, got 17"):
        compute_reference(LIGHT, ManyLobes(n=MAX_LOBES + 1), VIEW)
