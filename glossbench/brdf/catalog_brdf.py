"""The measured BRDFs of the catalogue as materials, each under its own name."""

from inspect import cleandoc
from pathlib import Path

from glossbench.brdf.material import MATERIALS
from glossbench.brdf.measured_file import FORMATS, MeasuredMaterial
from glossbench.catalog import Entry, entries, fetch_once


class CatalogBRDF(MeasuredMaterial):
    """f(wo, wi) of a public file, fetched when it is not here, and read as `measured` reads it."""

    def path(self) -> Path:
        """The verified file."""
        return fetch_once(self.name)


def _register(stated: Entry) -> None:
    """A class for one file, so that its name is a material like any other."""
    options = cleandoc(MeasuredMaterial.__doc__ or "").split("\n\n", 1)[1]
    about = f"{stated.stresses[0].upper()}{stated.stresses[1:]}: {stated.file} of the catalogue.\n\n{options}"
    MATERIALS.register(stated.name)(
        type(stated.name, (CatalogBRDF,), {"__doc__": about, "__module__": __name__, "__qualname__": stated.name})
    )


for _stated in entries("brdf"):
    if Path(_stated.file).suffix in FORMATS:
        _register(_stated)
