"""The fits of Ngan, Durand and Matusik 2005 to the MERL database, as materials by name."""

import re
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

from glossbench.brdf.cook_torrance import CookTorrance
from glossbench.brdf.lafortune import Lafortune
from glossbench.brdf.material import MATERIALS, Material, Reflectance
from glossbench.brdf.ward import Ward
from glossbench.catalog import entry, fetch_once
from glossbench.errors import InputError, nearest
from glossbench.surroundings import settled

Model = Literal["cook_torrance", "ward", "lafortune"]
NUMBER = r"[-+]?[\d.]+(?:e[-+]?\d+)?"
COLOR = rf"\[({NUMBER}), ({NUMBER}), ({NUMBER})\]"
# A line of each file, name = Aggregate(Lambertian(...), its model with these numbers).
NUMBERS = {
    "cook_torrance": rf"NganCookTorrance\(albedo = {COLOR}, eta = ({NUMBER}), roughness = ({NUMBER})\)",
    "ward": rf"NganWard\(albedo = {COLOR}, roughness = ({NUMBER})\)",
    "lafortune": rf"NganLafortune\(albedo = {COLOR}, Cxy = ({NUMBER}), Cz = ({NUMBER}), sharpness = ({NUMBER})\)",
}


@MATERIALS.register("ngan")
class Ngan(Material):
    """f(wo, wi) of a model fitted to a material of the MERL database, from the catalogue's tables of 86 materials.

    cook_torrance: `cook_torrance` with the factor 1/pi, the table's eta being f0: the highlights of its 25 metals,
    whose Fresnel term is flat, are then 0.87 times those of the Ward fits along the normal (median; 0.73 to 1.04 from
    the 10th to the 90th percentile). With a D that is not divided by pi it would be 2.7 times. ward: `ward` as of 1992.
    lafortune: `lafortune` with C_x = C_y, normalised.

    Attributes:
        material: one of the tables' names.
        model: cook_torrance, ward or lafortune.

    Source: Ngan et al. 2005; tables of github.com/bsdfbenchmark/bbm. The fits keep the scale of MERL files, whose
    mirror-like highlights are cut off: chrome reflects 6 %.
    """

    material: str
    model: Model = "cook_torrance"

    def __post_init__(self) -> None:
        super().__post_init__()
        if entry(_entry(self.model)).local() is not None:  # nothing is fetched before a run
            self.fitted()

    def fitted(self) -> Material:
        """The fit as a material of its model."""
        known = fits(fetch_once(_entry(self.model)), self.model)
        if self.material not in known:
            raise InputError(f"ngan.material: the tables have no {self.material!r}{nearest(self.material, known)}")
        return known[self.material]

    def reflectance(self, device: str = "cpu") -> Reflectance:
        """The model as tensors on a device."""
        return self.fitted().reflectance(device)

    def key(self) -> str:
        """That of the fit."""
        return f"ngan:{self.fitted().key()}"


def _entry(model: Model) -> str:
    """The catalogue's name of a table."""
    return f"ngan_{model.replace('_', '')}"


def fits(path: Path, model: Model) -> dict[str, Material]:
    """The materials of a table by name.

    Raises:
        InputError: a line that is none of this model.
    """
    stat = path.stat()
    return _fits(path, stat.st_size, stat.st_mtime_ns, model)


@lru_cache(maxsize=6)
@settled()
def _fits(path: Path, size: int, time: int, model: Model) -> dict[str, Material]:
    line_of = re.compile(rf"([\w-]+) = Aggregate\(Lambertian\(albedo = {COLOR}\), {NUMBERS[model]}\)")
    found: dict[str, Material] = {}
    try:
        lines = path.read_text(encoding="ascii").splitlines()
    except ValueError:
        raise InputError(f"{path}: no table of fits: holds more than plain text") from None
    for i, line in enumerate(lines, 1):
        if line.strip() and not line.startswith("#"):
            match = line_of.fullmatch(line.strip())
            if match is None:
                raise InputError(f"{path}:{i}: no {model} fit: {line.strip()[:60]!r}")
            name, *texts = match.groups()
            numbers = [float(text) for text in texts]
            found[name] = _material(model, tuple(numbers[:3]), tuple(numbers[3:6]), numbers[6:])
    if not found:
        raise InputError(f"{path}: no table of fits: it is empty")
    return found


def _material(model: Model, kd: Any, ks: Any, rest: list[float]) -> Material:
    if model == "cook_torrance":
        return CookTorrance(m=(rest[1],) * 2, f0=(rest[0],) * 3, factor="1/pi", ks=ks, kd=kd)
    if model == "ward":
        return Ward(m=(rest[0],) * 2, normalisation="ward", ks=ks, kd=kd)
    return Lafortune(C=(rest[0], rest[0], rest[1]), s=rest[2], ks=ks, kd=kd)
