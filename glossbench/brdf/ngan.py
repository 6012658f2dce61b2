"""The fits of Ngan, Durand and Matusik 2005 to the MERL database, as materials by name."""

import re
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

from glossbench.brdf.cook_torrance import CookTorrance
from glossbench.brdf.lafortune import Lafortune
from glossbench.brdf.material import MATERIALS, Material, Reflectance
from glossbench.brdf.ward import Ward
from glossbench.catalog.entries import fetch_once, find_entry
from glossbench.catalog.locate import locate
from glossbench.errors import InputError, suggest_nearest
from glossbench.file_bytes import require_size
from glossbench.process.surroundings import settled

Model = Literal["cook_torrance", "ward", "ward_duer", "lafortune"]
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
COLOR = rf"\[({NUMBER}),({NUMBER}),({NUMBER})\]"
OPTION = rf"\w+=(?:\[{NUMBER},{NUMBER},{NUMBER}\]|{NUMBER})"
# One line per material: name = Aggregate(Lambertian(...), model(numbers)); spaces around punctuation are ignored.
BLANKS = re.compile(r"\s*([=,()\[\]])\s*")
LINE = re.compile(rf"([\w.-]+)=Aggregate(?:Bsdf)?\(Lambertian\(albedo={COLOR}\),(\w+)\(({OPTION}(?:,{OPTION})*)\)\);?")
MODELS: dict[str, tuple[Model, tuple[str, ...]]] = {
    "NganCookTorrance": ("cook_torrance", ("albedo", "eta", "roughness")),
    "NganWard": ("ward", ("albedo", "roughness")),
    "NganWardDuer": ("ward_duer", ("albedo", "roughness")),
    "NganLafortune": ("lafortune", ("albedo", "Cxy", "Cz", "sharpness")),
}
MAX_BYTES = 1 << 24


@MATERIALS.register("ngan")
class Ngan(Material):
    """f(wo, wi) of a model fitted to a material of the MERL database; the tables of the catalogue have 86 materials.

    cook_torrance: `cook_torrance` with the factor 1/pi; the eta of the table is f0. Along the normal the highlights of
    its 25 metals, whose Fresnel term is flat, are then 0.87 times those of the Ward fits (median; 10th to 90th
    percentile 0.73 to 1.04). With a D that is not divided by pi it would be 2.7 times. ward: `ward` with the
    normalisation of 1992. ward_duer: `ward` with that of 2006. lafortune: `lafortune` with C_x = C_y, normalised.

    Attributes:
        material: one of the names in the table.
        model: cook_torrance (default), ward or lafortune; with a file, the model of the file is the default.
        file: path of a table of the same form, .fit, which may also be of ward_duer; a relative one is searched in the
            current folder, the folder of the study and below GLOSSBENCH_DATA.

    Source: Ngan et al. 2005; tables of github.com/bsdfbenchmark/bbm. The fits keep the scale of MERL files, whose
    mirror-like highlights are cut off: chrome reflects 6 %.
    """

    material: str
    model: Model | None = None
    file: str | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.file is None and self.model == "ward_duer":
            raise InputError("ngan.model 'ward_duer' needs a file: the catalogue has no table of it")
        if (
            self.file is not None or find_entry(self._find_entry()).find_local() is not None
        ):  # before a run nothing is downloaded
            self.build_fit()

    @classmethod
    def file_of(cls, option: str, value: str) -> str | None:
        """The table."""
        return "table of fits" if option == "file" else None

    def build_fit(self) -> Material:
        """The fit as a material of its model."""
        if self.file is None:
            known = read_fits(fetch_once(self._find_entry()), self.model or "cook_torrance")
        else:
            known = read_fits(locate(self.file, what="table of fits"), self.model)
        if self.material not in known:
            where = "the tables have" if self.file is None else f"{self.file} has"
            raise InputError(f"ngan.material: {where} no {self.material!r}{suggest_nearest(self.material, known)}")
        return known[self.material]

    def reflectance(self, device: str = "cpu") -> Reflectance:
        """The model as tensors on a device."""
        return self.build_fit().reflectance(device)

    def key(self) -> str:
        """The key of the fit."""
        return f"ngan:{self.build_fit().key()}"

    def _find_entry(self) -> str:
        """The catalogue's name of the table."""
        return f"ngan_{(self.model or 'cook_torrance').replace('_', '')}"


def read_fits(path: Path, model: Model | None = None) -> dict[str, Material]:
    """The materials of a table by name.

    Args:
        model: the model that all lines must have; by default any known model is accepted.

    Raises:
        InputError: a line is not a fit, or has another model.
    """
    require_size(path, "table of fits", MAX_BYTES)
    stat = path.stat()
    return _read_fits(path, stat.st_size, stat.st_mtime_ns, model)


@lru_cache(maxsize=6)
@settled()
def _read_fits(path: Path, size: int, time: int, model: Model | None) -> dict[str, Material]:
    found: dict[str, Material] = {}
    try:
        lines = [line.partition("#")[0] for line in path.read_text(encoding="utf-8-sig").splitlines()]
    except ValueError:
        raise InputError(f"{path}: not a table of fits: it holds more than plain text") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    for i, line in enumerate(lines, 1):
        if line.strip():
            try:
                name, fit = _fit(" ".join(line.split()), model)
            except InputError as error:
                raise InputError(f"{path}:{i}: {error}") from None
            if name in found:
                raise InputError(f"{path}:{i}: {name!r} is in the table twice")
            found[name] = fit
    if not found:
        raise InputError(f"{path}: not a table of fits: it is empty")
    return found


def _fit(line: str, wanted: Model | None) -> tuple[str, Material]:
    """Name and material of a line."""
    no_fit = f"not a fit{f' of {wanted}' if wanted else ''}"
    match = LINE.fullmatch(BLANKS.sub(r"\1", line))
    if match is None:
        raise InputError(f"{no_fit}: {line[:60]!r}")
    name, *kd, stated, options = match.groups()
    if stated not in MODELS:
        raise InputError(f"{no_fit}: unknown model {stated}; known: {', '.join(MODELS)}")
    model, wants = MODELS[stated]
    if wanted not in (None, model):
        raise InputError(f"{no_fit}: it is a fit of {model}")
    numbers: dict[str, Any] = {}
    for option in re.findall(OPTION, options):
        key, _, value = option.partition("=")
        numbers[key] = tuple(map(float, re.findall(NUMBER, value)))
    if {key: len(value) for key, value in numbers.items()} != {key: 3 if key == "albedo" else 1 for key in wants}:
        raise InputError(f"{no_fit}: {stated} needs {', '.join(wants)}, got {', '.join(numbers)}")
    return name, _build_material(model, tuple(map(float, kd)), **numbers)


def _build_material(model: Model, kd: Any, albedo: Any, **numbers: Any) -> Material:
    of = {key: value[0] for key, value in numbers.items()}
    if model == "cook_torrance":
        return CookTorrance(m=(of["roughness"],) * 2, f0=(of["eta"],) * 3, factor="1/pi", ks=albedo, kd=kd)
    if model == "lafortune":
        return Lafortune(C=(of["Cxy"], of["Cxy"], of["Cz"]), s=of["sharpness"], ks=albedo, kd=kd)
    return Ward(m=(of["roughness"],) * 2, normalisation="duer" if model == "ward_duer" else "ward", ks=albedo, kd=kd)
