"""A weighted sum of materials of any models."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any

from pydantic import BeforeValidator, GetJsonSchemaHandler, PlainSerializer
from pydantic_core import CoreSchema

from glossbench.brdf.material import MATERIALS, MAX_LOBES, Material, Reflectance
from glossbench.channels import Channels, add
from glossbench.errors import InputError
from glossbench.options import NonNegative
from glossbench.provenance import compute_source_hash


def _read_material(value: Any) -> Material:
    """A material as written in a study: a name, or one name with its options."""
    if isinstance(value, Material):
        return value
    if isinstance(value, str):
        return MATERIALS.create(value, {})
    if isinstance(value, Mapping) and len(value) == 1:
        [(name, options)] = value.items()
        if isinstance(options, Mapping | None):
            return MATERIALS.create(name, options or {})
    raise ValueError("must be a material's name, or one name with its options")


def _spell(material: Material) -> dict[str, Any]:
    return {material.name: material.as_dict()}


class _Schema:
    """The JSON Schema of a summand: the names of all registered materials."""

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        properties: dict[str, Any] = {name: {"type": ["object", "null"]} for name in MATERIALS.names()}
        named = {"type": "object", "properties": properties, "minProperties": 1, "maxProperties": 1}
        return {"anyOf": [{"enum": MATERIALS.names()}, {**named, "additionalProperties": False}]}


Summand = Annotated[Any, BeforeValidator(_read_material), PlainSerializer(_spell), _Schema]


@MATERIALS.register("sum")
class Sum(Material):
    """f(wo, wi) = sum of w_k f_k(wo, wi).

    Diffuse parts are added; all glossy lobes are kept, with ks multiplied by the weight of their material.

    Attributes:
        of: the materials, each a name or one name with its options, e.g. [{kurt: {m: 0.1}}, {phong: {s: 20}}], with at
            most 16 lobes together.
        weights: w_k >= 0, one per material; all are 1 by default.
    """

    of: tuple[Summand, ...]
    weights: tuple[NonNegative, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.of:
            raise InputError("sum.of needs at least one material")
        if self.weights and len(self.weights) != len(self.of):
            raise InputError(f"sum.weights must have one weight per material, {len(self.of)}, got {len(self.weights)}")
        n_lobes = len(self.reflectance().lobes)
        if n_lobes > MAX_LOBES:
            raise InputError(f"sum.of must have at most {MAX_LOBES} lobes in total, got {n_lobes}")

    def key(self) -> str:
        """Keys of the materials, hashes of their source files (this file does not import them), and the weights."""
        parts = [f"{material.key()} {compute_source_hash(type(material))}" for material in self.of]
        return f"{self.name}:{parts}:{list(self.weights)}"

    def reflectance(self, device: str = "cpu") -> Reflectance:
        """The model as tensors on a device."""
        return self._sum_parts([material.reflectance(device) for material in self.of])

    def as_lobes(self, device: str = "cpu") -> Reflectance:
        """The sum of the lobes from which methods draw samples for each material."""
        return self._sum_parts([material.as_lobes(device) for material in self.of])

    def notes(self) -> tuple[str, ...]:
        """The notes of the materials."""
        return tuple(note for material in self.of for note in material.notes())

    def _sum_parts(self, parts: list[Reflectance]) -> Reflectance:
        diffuse: Channels = ()
        lobes = []
        for part, weight in zip(parts, self.weights or (1.0,) * len(parts), strict=True):
            diffuse = add(diffuse, _scale(part.diffuse, weight))
            lobes += [replace(lobe, ks=_scale(lobe.ks, weight)) for lobe in part.lobes]
        return Reflectance(diffuse, tuple(lobes))


def _scale(channels: Channels, weight: float) -> Channels:
    return tuple(channel * weight for channel in channels)
