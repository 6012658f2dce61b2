"""The environments of the catalogue as lights, each under its own name."""

from inspect import cleandoc

from glossbench.catalog import Entry, entries, entry, fetch
from glossbench.envmap.cubemap import CubeMap
from glossbench.envmap.facts import LightFacts
from glossbench.envmap.lights import LIGHTS, FileLight, Light
from glossbench.options import Resolution


class CatalogLight(Light):
    """Radiance of a public file, fetched when it is not here, and read as the catalogue says.

    Attributes:
        resolution: texels along the edge of a face, a power of two; by default what the image resolves.
    """

    resolution: Resolution | None = None

    def file(self) -> FileLight:
        """The light of the verified file, which is fetched where it is not here."""
        stated = entry(self.name)
        return FileLight.create({"file": str(fetch(self.name)), "resolution": self.resolution, **stated.reading})

    def cubemap(self) -> CubeMap:
        """The radiance itself."""
        return self.file().cubemap()

    def facts(self, cubemap: CubeMap | None = None) -> LightFacts:
        """What the file holds, and how it was understood."""
        return self.file().facts(cubemap)

    def key(self) -> str:
        """That of the file: its bytes, and how they are read."""
        return self.file().key()


def _register(stated: Entry) -> None:
    """A class for one environment, so that its name is a light like any other."""
    options = cleandoc(CatalogLight.__doc__ or "").split("\n\n", 1)[1]
    about = f"{stated.stresses[0].upper()}{stated.stresses[1:]}: {stated.file} of the catalogue.\n\n{options}"
    LIGHTS.register(stated.name)(
        type(stated.name, (CatalogLight,), {"__doc__": about, "__module__": __name__, "__qualname__": stated.name})
    )


for _stated in entries("environment"):
    _register(_stated)
