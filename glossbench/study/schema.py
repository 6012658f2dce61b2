"""The keys of a study with their types and bounds, and the same as JSON Schema for editors."""

import re
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from glossbench.brdf.measured_file import FORMATS
from glossbench.documentation import read_attributes, read_first_line
from glossbench.memory import read_size
from glossbench.options import Finite, Options, Seed, make_schema
from glossbench.registry import Registry
from glossbench.scene.mesh_files import READERS
from glossbench.study.claims import KINDS, Name
from glossbench.study.registries import REGISTRIES
from glossbench.study.shared_schema import share_parts
from glossbench.truth.reference import ReferenceMethod
from glossbench.truth.sampling import FIRST_SAMPLES, N_REPLICATES

KINDS_OF_ITEMS = {"light": "light", "material": "material", "view": "view", "methods": "method"}  # by key of a study
# For each kind that may be the bare name of a file: the endings of such files. A light's file may have any ending.
ENDINGS = {"light": (), "material": (*FORMATS, ".fit"), "view": tuple(READERS)}
MAX_ENTRIES = 1000  # in claims and in exclude, because each is compared with every cell


class ReferenceOptions(BaseModel):
    """How the reference is computed.

    Attributes:
        relative_error: RMS of its standard error, divided by its mean, at which the reference is accurate enough.
        seed: seed of its scrambles; default: the study's.
        max_samples: samples per pixel and technique at which the reference stops in any case.
        method: summation is exact up to a stated error, for views whose points hide no light from each other; sampling
            works for every view; auto takes the one that is predicted to meet relative_error with less work.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)
    relative_error: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 1e-3
    seed: Seed = 0
    max_samples: Annotated[int, Field(ge=N_REPLICATES * FIRST_SAMPLES)] = 1 << 16
    method: ReferenceMethod = "auto"

    def with_seed(self, seed: int) -> Self:
        """The options for another seed of their study."""
        if "seed" in self.model_fields_set:
            return self
        return self.model_construct(self.model_fields_set, **{**self.model_dump(), "seed": seed})


def _find_module(name: str) -> str:
    if name.endswith(".py"):
        raise ValueError(f"must be the dotted name of a module, without .py: {name.removesuffix('.py')}")
    if not all(part.isidentifier() for part in name.split(".")):
        raise ValueError("must be the dotted name of a module, such as my_lab.my_method")
    return name


def _check_size(text: str) -> str:
    if read_size(text) is None:
        raise ValueError(f"must be a number and kB, MB, GB or TB, such as 4 GB: {text}")
    return text


class StudyKeys(BaseModel):
    """The keys of a study. The options of an item depend on its name.

    Attributes:
        title: title of the study, one line.
        source: the paper, figure or table that it reproduces.
        question: the question that it asks, as its report prints it.
        light: a light, or a list of lights: an image file, a name, or a name with its options.
        material: a material, or a list of materials: a name, or a name with its options.
        view: a view, or a list of views: a name, or a name with its options.
        methods: a method, or a list of methods: a name, or a name with its options.
        reference: how the reference is computed.
        metrics: an error to be measured, or a list of errors: a name, or a name with its options.
        claims: sentences to be checked, each with the cells that it is about.
        exclude: mappings of light, material, view, method or an option to a value; cells that fit all of one mapping
            are left out.
        seed: seed of the reference, and of methods without a stated seed.
        device: device on which methods are computed.
        memory: memory that all processes of a run may take together, such as 4 GB. A run that is predicted to take more
            is refused.
        time_limit: seconds that a cell may take, without its reference; a cell that takes longer has failed.
        plugins: modules that register methods, materials, lights, views or metrics: installed, or in this folder.
    """

    model_config = ConfigDict(extra="forbid", strict=True)
    title: Name
    source: str = ""
    question: str = ""
    light: Any
    material: Any
    view: Any
    methods: Any
    reference: ReferenceOptions = ReferenceOptions()
    metrics: Any = ["rms", "relative_rms", "mean_error", "max_error"]
    claims: Annotated[list[Any], Field(max_length=MAX_ENTRIES)] = []
    exclude: Annotated[list[dict[str, Any]], Field(max_length=MAX_ENTRIES)] = []
    seed: Seed = 0
    device: Literal["cpu", "cuda"] = "cpu"
    memory: Annotated[str, AfterValidator(_check_size)] | None = None
    time_limit: Annotated[float, Field(gt=0, le=1e7)] = 3600.0
    plugins: list[Annotated[str, AfterValidator(_find_module)]] = []


class TuneKeys(BaseModel):
    """What a study states instead of the value of an option, to let a run search for the best value.

    Attributes:
        tune: the error to be minimised.
        range: [low, high], the interval that is searched; by default the bounds of the option.
    """

    model_config = ConfigDict(extra="forbid", strict=True)
    tune: str
    range: Annotated[list[Finite], Field(min_length=2, max_length=2)] | None = None


def schema() -> dict[str, Any]:
    """JSON Schema of a study, with the options of every registered light, material, view and method."""
    top = _make_model_schema(StudyKeys)
    for key, kind in {**KINDS_OF_ITEMS, "metrics": "metric"}.items():
        item = _make_item_schema(key, REGISTRIES[kind])
        top["properties"][key]["anyOf"] = [item, {"type": "array", "items": item, "minItems": 1}]
    top["properties"]["claims"]["items"] = {"anyOf": [_make_model_schema(model) for model in KINDS.values()]}
    definitions: dict[str, Any] = {}
    top = _hoist(top, definitions)
    schema_of = "https://json-schema.org/draft/2020-12/schema"
    return share_parts({"$schema": schema_of, **top, "title": "glossbench study", "$defs": definitions})


def _make_model_schema(model: type[BaseModel]) -> dict[str, Any]:
    """The schema of a model; each key has its description from the docstring."""
    stated = model.model_json_schema()
    for of, own in ((model, stated), (ReferenceOptions, stated.get("$defs", {}).get("ReferenceOptions", {}))):
        texts = read_attributes(of)
        for key, value in own.get("properties", {}).items():
            value.pop("title", None)
            if key in texts:
                value["description"] = texts[key]
        if own:
            own["description"] = read_first_line(of)
    return stated


def _hoist(stated: Any, definitions: dict[str, Any]) -> Any:
    """The schema with all nested definitions moved to `definitions`, where its references look for them."""
    if isinstance(stated, list):
        return [_hoist(one, definitions) for one in stated]
    if not isinstance(stated, dict):
        return stated
    definitions |= {name: _hoist(one, definitions) for name, one in stated.get("$defs", {}).items()}
    return {key: _hoist(value, definitions) for key, value in stated.items() if key != "$defs"}


def _make_item_schema(kind: str, registry: Registry[Any]) -> dict[str, Any]:
    """The schema of an item: a name, or one name with options; a light, material or view may be a file."""
    options = {name: _make_options_schema(registry.get(name), kind == "methods") for name in registry.names()}
    named = {name: {"anyOf": [of_name, {"type": "null"}]} for name, of_name in options.items()}
    one = {
        "type": "object",
        "properties": named,
        "additionalProperties": False,
        "minProperties": 1,
        "maxProperties": 1,
    }
    if kind in ENDINGS:
        file = f"({'|'.join(map(re.escape, ENDINGS[kind]))})$" if ENDINGS[kind] else r"\.\w+$"
        one["patternProperties"] = {file: {"type": ["object", "null"]}}
    if kind == "light":
        return {"anyOf": [{"type": "string"}, {**options["file"], "required": ["file"]}, one]}
    bare = [{"type": "string", "pattern": file}] if kind in ENDINGS else []
    return {"anyOf": [{"enum": registry.names()}, one, *bare]}


def _make_options_schema(cls: type[Options], tunable: bool) -> dict[str, Any]:
    """The schema of a class's options: each takes a value or a list of values; a method's option may be tuned."""
    stated, texts = make_schema(cls), read_attributes(cls)
    properties: dict[str, Any] = {}
    lists: dict[str, Any] = {}
    for option, value in stated["properties"].items():
        beside = {"default": value.pop("default")} if "default" in value else {}
        if option in texts:
            beside["description"] = texts[option]
        # A scalar stands for equal components of a vector.
        forms = [value, *value.get("prefixItems", [])[:1]]
        lists[option] = {"type": "array", "items": {"anyOf": forms}, "minItems": 1}
        tuned = [_make_model_schema(TuneKeys)] if tunable else []
        properties[option] = {"anyOf": [*forms, lists[option], *tuned], **beside}
    if not properties:
        return {"type": "object", "maxProperties": 0}
    if len(lists) > 1:  # a single list needs no zip
        properties["zip"] = {
            "type": "object", "properties": lists, "additionalProperties": False,
            "description": "lists of equal length; their first values go together, then their second, and so on",
        }  # fmt: skip
    return {**stated, "description": read_first_line(cls), "properties": properties}
