"""The model of Lafortune, Foo, Torrance and Greenberg 1997: a sum of generalised cosine lobes."""

from collections.abc import Mapping
from math import exp, log, pi
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from glossbench.brdf.cosine_lobe import MIRROR, CosineLobe, Exponent, cosine_lobe
from glossbench.brdf.material import MATERIALS, Material, Reflectance
from glossbench.channels import channels_unless_black
from glossbench.errors import InputError
from glossbench.options import Color, Finite, Options
from glossbench.options import Radiance as Factor  # a scalar or RGB, not negative


def _check_nonzero(value: tuple[float, float, float]) -> tuple[float, float, float]:
    if not any(value):
        raise ValueError("must have a component other than 0")
    return value


Diagonal = Annotated[tuple[Finite, Finite, Finite], AfterValidator(_check_nonzero)]


class LafortuneLobe(Options):
    """One of several lobes, with the options of the model itself."""

    name = "lobe"

    C: Diagonal = MIRROR
    s: Exponent = 20.0
    ks: Factor = (1.0, 1.0, 1.0)


def _read_lobe(value: Any) -> Any:
    return LafortuneLobe.create(value) if isinstance(value, Mapping) else value


@MATERIALS.register("lafortune")
class Lafortune(Material):
    """f(wo, wi) = kd / pi + sum over lobes of ks N max(C_x wo_x wi_x + C_y wo_y wi_y + C_z wo_z wi_z, 0)^s.

    -C_x = -C_y = C_z is a Phong lobe; -C_x = -C_y > C_z is an off-specular lobe that grows towards grazing views;
    C_x = C_y > 0 reflects light back to its source; C_x != C_y is anisotropic. Reciprocal. The albedo of a lobe is at
    most ks N 2 pi max|C_k|^s / (s + 2), which it reaches along the normal if C_z is the largest. Energy is conserved if
    kd and these bounds sum to at most 1. A larger sum is allowed, because fits to measurements exceed 1.

    Attributes:
        C: C_x, C_y, C_z, of any sign, not all 0.
        s: the paper's exponent n, in [0, 1e5].
        ks: the paper's rho_s, a scalar or RGB >= 0.
        kd: diffuse albedo, a scalar or RGB in [0, 1].
        normalisation: "albedo" is N = (s + 2) / (2 pi max|C_k|^s): ks bounds the albedo of its lobe, and the length of
            C has no effect. "none" is N = 1: the length counts, as in published fits of the paper's eq. 4.
        lobes: up to 16 lobes, each a mapping of C, s, ks; they replace the options C, s and ks. If a fit has one C or
            one exponent per colour channel, write one lobe per channel, whose ks is 0 in the other channels.

    Source: Lafortune et al. 1997 eq. 4; the normalisation as Ngan et al. 2005 use it in their fits.
    """

    C: Diagonal = MIRROR
    s: Exponent = 20.0
    ks: Factor = (1.0, 1.0, 1.0)
    kd: Color = (0.0, 0.0, 0.0)
    normalisation: Literal["albedo", "none"] = "albedo"
    lobes: Annotated[tuple[Annotated[LafortuneLobe, BeforeValidator(_read_lobe)], ...], Field(max_length=16)] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.normalisation == "none":
            for lobe in self._list_lobes():
                # max|C|^s must fit into a float32, also multiplied by ks.
                if lobe.s * log(max(map(abs, lobe.C))) > 69:
                    raise InputError(f"lafortune: max|C|^s must be below 1e30, got C = {lobe.C} and s = {lobe.s}")

    def reflectance(self, device: str = "cpu") -> Reflectance:
        """The model as tensors on a device."""
        diffuse = channels_unless_black(self.kd, device)
        return Reflectance(diffuse, tuple(self._build_lobe(lobe, device) for lobe in self._list_lobes()))

    def _list_lobes(self) -> tuple[LafortuneLobe, ...]:
        return self.lobes or (LafortuneLobe(C=self.C, s=self.s, ks=self.ks),)

    def _build_lobe(self, lobe: LafortuneLobe, device: str) -> CosineLobe:
        bound = 1.0
        if self.normalisation == "none":
            bound = 2 * pi / (lobe.s + 2) * exp(lobe.s * log(max(map(abs, lobe.C))))
        return cosine_lobe(lobe.C, lobe.s, tuple(ks * bound for ks in lobe.ks), device)
