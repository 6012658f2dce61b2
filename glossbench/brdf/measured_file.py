"""Measured materials from files: the reference uses the table; methods that draw samples use lobes fitted to it."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field
from torch import Tensor

from glossbench.brdf.material import MATERIALS, Material, Reflectance
from glossbench.brdf.measured.cornell import read_cornell
from glossbench.brdf.measured.fitting import Fit, fit_lobes
from glossbench.brdf.measured.lobe import MeasuredLobe, Table, build_measured_lobe
from glossbench.brdf.measured.merl import read_merl
from glossbench.brdf.measured.rgl import read_rgl
from glossbench.catalog.locate import locate
from glossbench.directions import Vec3, cosine_hemisphere, points_2d
from glossbench.errors import InputError
from glossbench.file_bytes import compute_file_digest
from glossbench.process.surroundings import settled

Format = Literal["cornell", "merl", "rgl"]
READERS: dict[Format, Callable[[Path, str], tuple[Table, int]]] = {
    "cornell": read_cornell,
    "merl": read_merl,
    "rgl": read_rgl,
}
FORMATS: dict[str, Format] = {".brdf": "cornell", ".binary": "merl", ".bsdf": "rgl"}

MAX_BYTES = 1 << 30


@dataclass(frozen=True)
class MeasuredFacts:
    """Facts about a measurement.

    Attributes:
        format: cornell, merl or rgl.
        known_share: share of all pairs of directions that was measured, by projected solid angle, in [0, 1].
        n_negative: number of values below 0, which count as 0.
        fit: lobes for methods that draw samples; None if they use the table.
    """

    format: Format
    known_share: float
    n_negative: int
    fit: Fit | None


class MeasuredMaterial(Material):
    """f(wo, wi) of an isotropic measurement.

    The reference uses the table itself, sampled by a tabulated density of half vectors; so does every method that
    evaluates f at directions that it chooses. Methods that draw samples from lobes use a fit, so their error includes
    the error of the fit.

    Attributes:
        unknown: f where nothing was measured: "black" or "extrapolated". The extrapolated value is the product of the
            factors (cornell) or the authors' own (rgl); for merl it is always black.
        samplers: from what methods draw samples: fitted lobes of a model, or "table", the table with its own density.
        lobes: number of lobes of the fit; it has a diffuse part too.
    """

    unknown: Literal["black", "extrapolated"] = "black"
    samplers: Literal["kurt", "ward", "cosine_lobes", "table"] = "kurt"
    lobes: Annotated[int, Field(ge=1, le=4)] = 2

    def path(self) -> Path:
        """The file; a file of the catalogue is fetched if it is not on this machine."""
        raise NotImplementedError

    def format_of(self, path: Path) -> Format:
        """The format of the file."""
        return FORMATS[path.suffix.lower()]

    def reflectance(self, device: str = "cpu") -> Reflectance:
        """The table as a lobe."""
        return Reflectance((), (self._load_lobe(device)[0],))

    def as_lobes(self, device: str = "cpu") -> Reflectance:
        """The fit, or the table."""
        fit = self.fit()
        return self.reflectance(device) if fit is None else fit.material.reflectance(device)

    def fit(self) -> Fit | None:
        """The lobes from which methods draw samples, with their error; None if they use the table itself."""
        if self.samplers == "table":
            return None
        return _fit(*self._read_as(), self.unknown == "black", self.samplers, self.lobes)

    def known(self, wo: Vec3, wi: Vec3) -> Tensor:
        """Whether f was measured there."""
        return self._load_lobe("cpu")[0].table.known(wo, wi) & (wo.z > 0) & (wi.z > 0)

    def facts(self) -> MeasuredFacts:
        """Facts about the file, and the error of the fit."""
        a, b = (cosine_hemisphere(points_2d(1 << 16, kind)) for kind in ("hammersley", "r2"))
        share = float(self.known(a, b).double().mean())
        return MeasuredFacts(self._read_as()[2], share, self._load_lobe("cpu")[1], self.fit())

    def notes(self) -> tuple[str, ...]:
        """The facts in one line."""
        facts = self.facts()
        elsewhere = self.unknown if facts.format != "merl" else "black"
        told = f"{self.path().name}: {100 * facts.known_share:.1f} % of all pairs of directions measured, "
        told += f"{elsewhere} elsewhere; {facts.n_negative} negative values taken as 0"
        if facts.fit is None:
            return (f"{told}; samplers take the table",)
        model, n = self.samplers.removesuffix("_lobes"), self.lobes
        lobes = f"{n} {model} lobe{'s' * (n > 1)}"
        return (f"{told}; samplers take {lobes}, errors {facts.fit.mean_error:.3f} (L1), {facts.fit.error:.3f} (L2)",)

    def key(self) -> str:
        """Hash of the file's bytes, and the options that say how to read it."""
        _, digest, format_ = self._read_as()
        reading = {k: v for k, v in self.as_dict().items() if k not in ("file", "format")}
        return f"measured:{format_}:{digest}:{json.dumps(reading, sort_keys=True)}"

    def _read_as(self) -> tuple[Path, str, Format]:
        path = self.path()
        return path, compute_file_digest(path, "BRDF file", MAX_BYTES), self.format_of(path)

    def _load_lobe(self, device: str) -> tuple[MeasuredLobe, int]:
        return _read_lobe(*self._read_as(), self.unknown == "black", device)


# Cached: every stage of every cell asks a material for its lobes, and reading a file takes seconds.


@lru_cache(maxsize=4)
@settled()
def _read_lobe(path: Path, content: str, format_: Format, known_only: bool, device: str) -> tuple[MeasuredLobe, int]:
    """The lobe of a file, and the number of its negative values."""
    try:
        table, n_negative = READERS[format_](path, device)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    if compute_file_digest(path, "BRDF file", MAX_BYTES) != content:
        raise InputError(f"{path}: was changed while it was read; run it again")
    return build_measured_lobe(table, known_only, device), n_negative


@lru_cache(maxsize=16)
@settled()
def _fit(
    path: Path,
    digest: str,
    format_: Format,
    known_only: bool,
    model: Literal["kurt", "ward", "cosine_lobes"],
    n_lobes: int,
) -> Fit:
    return fit_lobes(_read_lobe(path, digest, format_, known_only, "cpu")[0], model, n_lobes)


def resolve_material(text: str) -> tuple[str, dict[str, Any]]:
    """The material that one word means: a registered name, or the path of a measurement or of fits with its option."""
    of_file = {**dict.fromkeys(FORMATS, "measured"), ".fit": "ngan"}.get(Path(text).suffix.lower())
    return (of_file, {"file": text}) if of_file and text not in MATERIALS.names() else (text, {})


@MATERIALS.register("measured")
class Measured(MeasuredMaterial):
    """f(wo, wi) of an isotropic file of Cornell's goniometer, the MERL database or the RGL material database.

    The reference uses the table itself, sampled by a tabulated density of half vectors; so does every method that
    evaluates f at directions that it chooses. Methods that draw samples from lobes use a fit, so their error includes
    the error of the fit.

    Attributes:
        file: path of the measurements; a relative one is searched in the current folder, the folder of the study and
            below GLOSSBENCH_DATA.
        format: format of the file; by default it follows from the extension: .brdf cornell, .binary merl, .bsdf rgl.
        unknown: f where nothing was measured: "black" or "extrapolated". The extrapolated value is the product of the
            factors (cornell) or the authors' own (rgl); for merl it is always black.
        samplers: from what methods draw samples: fitted lobes of a model, or "table", the table with its own density.
        lobes: number of lobes of the fit; it has a diffuse part too.

    Source: the readers, `glossbench.brdf.measured`: Latta and Kolb 2002 section 3.3; Matusik et al. 2003; Dupuy and
    Jakob 2018.
    """

    file: str
    format: Format | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.format is None and Path(self.file).suffix.lower() not in FORMATS:
            raise InputError(f"measured.format must be stated: {self.file!r} ends in none of {', '.join(FORMATS)}")

    @classmethod
    def file_of(cls, option: str, value: str) -> str | None:
        """The table."""
        return "BRDF file" if option == "file" else None

    def open_files(self) -> None:
        """The table."""
        self.reflectance()

    def path(self) -> Path:
        """The file."""
        return locate(self.file, what="BRDF file")

    def format_of(self, path: Path) -> Format:
        """The option `format`; by default the extension decides."""
        return self.format or super().format_of(path)
