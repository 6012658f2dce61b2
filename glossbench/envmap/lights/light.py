"""Lights: named options that become a cube map."""

from glossbench.catalog.naming import explain_catalog_name
from glossbench.envmap.cubemap import CubeMap
from glossbench.envmap.lights.facts import LightFacts, collect_facts
from glossbench.options import Options
from glossbench.registry import Registry


class Light(Options):
    """Incoming radiance by name and options."""

    def cubemap(self) -> CubeMap:
        """The radiance itself."""
        raise NotImplementedError

    def facts(self, cubemap: CubeMap | None = None) -> LightFacts:
        """Facts about the light; pass its cube map if it exists already."""
        return collect_facts(self.cubemap() if cubemap is None else cubemap)


LIGHTS: Registry[Light] = Registry("light", "glossbench.envmap.lights", "glossbench.lights", explain_catalog_name)
