"""The environments of the catalogue as lights, each under its own name."""

from functools import cached_property

from glossbench.catalog.entries import fetch, find_entry, list_entries
from glossbench.catalog.naming import register_entries
from glossbench.envmap.cubemap import CubeMap
from glossbench.envmap.lights.facts import LightFacts
from glossbench.envmap.lights.file_light import FileLight
from glossbench.envmap.lights.light import LIGHTS, Light
from glossbench.options import Resolution


class CatalogLight(Light):
    """Radiance of a public file. It is fetched if it is not on this machine, and read as the catalogue states.

    Attributes:
        resolution: texels along the edge of a face, a power of two; by default the one nearest to the image's.
    """

    resolution: Resolution | None = None

    @cached_property
    def _file(self) -> FileLight:
        """The light of the verified file, which is fetched if it is not on this machine."""
        stated = find_entry(self.name)
        return FileLight.create({"file": str(fetch(self.name)), "resolution": self.resolution, **stated.reading})

    def cubemap(self) -> CubeMap:
        """The radiance itself."""
        return self._file.cubemap()

    def facts(self, cubemap: CubeMap | None = None) -> LightFacts:
        """Facts about the light of the file, and how the file was read."""
        return self._file.facts(cubemap)

    def notes(self) -> tuple[str, ...]:
        """The notes of the file."""
        return self._file.notes()

    def key(self) -> str:
        """The key of the file: its bytes, and the options that say how to read them."""
        return self._file.key()


register_entries(LIGHTS, CatalogLight, list_entries("environment"), CatalogLight)
