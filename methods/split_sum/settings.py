"""What a split sum consists of, and the choices of known programs as one table of presets."""

from dataclasses import dataclass
from math import log, pi
from typing import Literal

from glossbench.prefilter import RoundShape, Weight

from .mappings import MappingName

Estimator = Literal["exhaustive", "fis", "hybrid", "cone"]
TexelArea = Literal["cube", "octahedral", "output"]
Source = Literal["light", "three_r185", "eevee"]
Direction = Literal["mirror", "filament", "frostbite", "hdrp"]
Final = Literal["table", "fit"]
Storage = Literal["float32", "half", "r11g11b10"]
Preset = Literal[
    "filament", "hdrp", "unreal", "three_r187", "three_r185", "godot", "babylon", "gltf_ibl_sampler", "playcanvas",
    "bevy", "eevee", "karis",
]  # fmt: skip

LEVEL_0 = -16.0  # a bias below all levels: samples read the light itself
FOUR_PI = log(4 * pi, 4)  # 1.83 levels: the 4 pi of the sphere is left out


@dataclass(frozen=True)
class Settings:
    """All options of the method without its preset; the defaults are the floor of the family, see `SplitSum`."""

    lobe: RoundShape = "ggx"
    weight: Weight = "g2"
    estimator: Estimator = "exhaustive"
    samples: tuple[int, ...] = (1024,)
    tail: float = 1.0
    lod_bias: float | Literal["alpha"] = 0.0
    texel_area: TexelArea = "cube"
    sum_edge: int | None = None
    source: Source = "light"
    resolution: int = 256
    levels: int = 6
    smallest: int = 1
    mapping: MappingName = "exact"
    storage: Storage = "float32"
    direction: Direction = "mirror"
    final: Final = "table"
    multiscatter: bool = False


# Sources: see `SplitSum`. What its sources do not state was read in those that a comment names; see decision 033.
PRESETS: dict[Preset, Settings] = {
    "karis": Settings(
        weight="cos", estimator="fis", samples=(1024,), lod_bias=LEVEL_0,
        mapping="linear",  # not stated in the notes
        storage="half",  # not stated in the notes
    ),
    "filament": Settings(
        weight="cos", estimator="fis", samples=(1024, 2048, 4096, 8192), lod_bias=1.0, levels=5, mapping="filament",
        direction="filament",
        storage="r11g11b10",  # of the KTX files of cmgen fddf51d
    ),
    "hdrp": Settings(
        weight="g2", estimator="fis", samples=(21, 34, 55, 89, 89, 89), lod_bias="alpha", levels=7, mapping="hdrp",
        direction="hdrp",
        storage="half",  # 256 and half are those of a sky, 8caaf87; a probe has 128 and r11g11b10
    ),
    "unreal": Settings(
        weight="cos", estimator="fis", samples=(32, 64), tail=0.995, lod_bias=-0.5, levels=8, mapping="unreal",
        resolution=128, direction="frostbite", storage="half",  # of captures in 5.8; a sky in real time has r11g11b10
    ),
    "three_r187": Settings(
        weight="cos", estimator="hybrid", samples=(256,), lod_bias=0.5, sum_edge=16, levels=6, mapping="filament",
        storage="half",
    ),
    "three_r185": Settings(
        weight="cos", estimator="fis", samples=(2048,), source="three_r185", levels=11, smallest=16,
        mapping="three_r185", storage="half",
    ),
    "godot": Settings(
        weight="cos", estimator="fis", texel_area="octahedral", levels=8, mapping="godot", storage="half",
        samples=(32,),  # default of db04c23; later sources also have another texel area
    ),
    "babylon": Settings(
        weight="cos", estimator="fis", lod_bias=1.0, levels=9, mapping="babylon", storage="half",
        samples=(4096,),  # its offline quality, the default of 18a3c25
    ),
    "gltf_ibl_sampler": Settings(
        weight="cos", estimator="fis", samples=(1024,), lod_bias=FOUR_PI, mapping="linear", storage="half",
        levels=8,  # floor(log2 of the resolution), 0138f41
    ),
    "playcanvas": Settings(
        weight="cos", estimator="fis", samples=(1024,), lod_bias=FOUR_PI, levels=6, mapping="playcanvas",
        resolution=128,  # add8005
        storage="half",  # 8 bits of RGBP by default
    ),
    "bevy": Settings(
        weight="cos_g", estimator="fis", texel_area="output", levels=9, mapping="linear", direction="frostbite",
        samples=(32, 64, 64, 128, 128, 256, 256, 512), storage="half",  # 32 * 2^floor(4 r), 07e73ef
    ),
    "eevee": Settings(
        lobe="sg", weight="one", estimator="cone", samples=(196,), source="eevee", levels=5, mapping="eevee",
        direction="frostbite", storage="half",
    ),
}  # fmt: skip
