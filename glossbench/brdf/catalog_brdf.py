"""The measured BRDFs of the catalogue as materials, each under its own name."""

from pathlib import Path

from glossbench.brdf.material import MATERIALS
from glossbench.brdf.measured_file import FORMATS, MeasuredMaterial
from glossbench.catalog.entries import fetch_once, list_entries
from glossbench.catalog.naming import register_entries


class CatalogBRDF(MeasuredMaterial):
    """f(wo, wi) of a public file. It is fetched if it is not on this machine, and read as `measured` reads it."""

    def path(self) -> Path:
        """The verified file."""
        return fetch_once(self.name)


_measured = [each for each in list_entries("brdf") if Path(each.file).suffix in FORMATS]
register_entries(MATERIALS, CatalogBRDF, _measured, MeasuredMaterial)
