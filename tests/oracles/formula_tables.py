"""Tables of measured BRDFs whose values are known by a formula."""

from dataclasses import dataclass

from glossbench.brdf.material import Material


@dataclass(frozen=True)
class ByFormula:
    """A table of unlimited resolution: a material; known where both directions are within 80 degrees."""

    material: Material

    def value(self, wo, wi):
        f = self.material.f(wo, wi)
        return f if len(f) == 3 else f * 3

    def known(self, wo, wi):
        return (wo.z > 0.17) & (wi.z > 0.17)
