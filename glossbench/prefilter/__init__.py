"""The parts of methods: the only module of glossbench that a method imports.

It exports by name the parts of the rooms below that methods use, and the parts that several methods share, which are in
this room: stages, shadows, median cut, cosine lobes, the lighting function. The files of this room import each other
and the rooms below (truth, shading, metrics, scene, brdf, envmap, process, catalog, and the loose files), never this
list.
"""

from glossbench.brdf.cosine_lobe import MIRROR, CosineLobe
from glossbench.brdf.lobe import Lobe, Sampler
from glossbench.brdf.material import Material, Reflectance
from glossbench.brdf.microfacet import Microfacet
from glossbench.catalog.locate import locate
from glossbench.channels import LUMINANCE, Channels, merge_channels, widen
from glossbench.directions import (
    SEEDED,
    PointSet,
    Vec3,
    cosine_hemisphere,
    cross,
    dot,
    half_vector,
    lerp,
    normalize,
    points_2d,
    reflect,
    scale,
    spherical,
    stack,
    to_local,
    to_world,
    vec3,
)
from glossbench.envmap.cubemap import CubeMap, add_border, face_coordinates, texel_directions, texel_solid_angles
from glossbench.envmap.formats.files import read_file
from glossbench.envmap.formats.image_content import ImageContent
from glossbench.envmap.harmonics import project, sh_basis
from glossbench.envmap.importance import luminance_distribution
from glossbench.envmap.projections.conversion import from_cubemap
from glossbench.envmap.projections.resampling import bilinear
from glossbench.envmap.pyramid import (
    Environment,
    Pyramid,
    Taps,
    finest,
    join_levels,
    lookup,
    weighted_radiance,
)
from glossbench.errors import InputError
from glossbench.factorization import (
    FactorMap,
    Floats,
    Solver,
    average_start,
    factorize,
    grid_laplacian,
    grid_rows,
    neighbour_laplacian,
    weight_rows,
)
from glossbench.options import Color, Finite, Fraction, NonNegative, Resolution, Seed
from glossbench.prefilter.cosine_lobes.calibration import (
    N_ANGLES,
    N_AZIMUTHS,
    REACH,
    LobeLevels,
    Volume,
    calibrate,
    match_levels,
)
from glossbench.prefilter.cosine_lobes.lighting import Energy, Maps, lobe_radiance, lobe_sums, n_lookups, no_lobe_sums
from glossbench.prefilter.cosine_lobes.lobe_sum import LobeSum
from glossbench.prefilter.cosine_lobes.pyramid import (
    LOBE_FILTERS,
    TEXEL_BYTES,
    LobeFilter,
    PartialMaps,
    build_partial_maps,
    cube_bytes,
    window_taps,
)
from glossbench.prefilter.diffuse import diffuse_radiance, visible_diffuse
from glossbench.prefilter.filtered_samples import FilteredSamples, filtered_samples
from glossbench.prefilter.ggx_chain import ggx_levels, level_of_alpha
from glossbench.prefilter.light_shadows import NoShadows, Shadows, Visibility, no_shadows, shadows
from glossbench.prefilter.lighting_function import LightingSamples, TexelWeight, anisotropy, sample_lighting_function
from glossbench.prefilter.median_cut import Partition, make_whole, median_cut
from glossbench.prefilter.pyramids import MipFilter, build_pyramid, halve
from glossbench.prefilter.round_lobes import (
    ROUND_LOBES,
    RoundCosine,
    RoundGaussian,
    RoundGGX,
    RoundLobe,
    RoundShape,
    Weight,
)
from glossbench.prefilter.stages import albedos, irradiance, pyramid
from glossbench.prefilter.texel_sums import sum_over_level, sum_over_tree
from glossbench.prefilter.view_table import ViewTable, tabulate
from glossbench.scene.points import Occluder, ShadingPoints, View
from glossbench.scene.virtual_cube import pair_points, tangent, valid_pairs
from glossbench.shading.costs import Costs, Timing
from glossbench.shading.kernels import Kernel, PerPoint, kernel, over_points
from glossbench.shading.method import METHODS, Contract, Method, stage
from glossbench.shading.visibility import occluder_of, unhidden
from glossbench.shapes import Radiance
from glossbench.truth.sampling import estimates

__all__ = [
    # The interface of a method, and its registry.
    "Contract",
    "InputError",
    "METHODS",
    "Method",
    "stage",
    # Images of other programs, and their costs.
    "Costs",
    "ImageContent",
    "Timing",
    "locate",
    "read_file",
    # Types of options, with bounds that are checked in YAML, in Python and on the command line.
    "Color",
    "Finite",
    "Fraction",
    "NonNegative",
    "Resolution",
    "Seed",
    # Directions as components, and points of the unit square.
    "PointSet",
    "SEEDED",
    "Vec3",
    "cosine_hemisphere",
    "cross",
    "dot",
    "half_vector",
    "lerp",
    "normalize",
    "points_2d",
    "reflect",
    "scale",
    "spherical",
    "stack",
    "to_local",
    "to_world",
    "vec3",
    # The light: a cube map, its texels and quantities computed from them.
    "CubeMap",
    "bilinear",
    "add_border",
    "face_coordinates",
    "from_cubemap",
    "luminance_distribution",
    "project",
    "sh_basis",
    "texel_directions",
    "texel_solid_angles",
    # The filtered light: pyramids, and lookups in them.
    "Environment",
    "MipFilter",
    "Pyramid",
    "Taps",
    "build_pyramid",
    "finest",
    "halve",
    "join_levels",
    "lookup",
    "weighted_radiance",
    # The light filtered by round lobes of GGX, by alpha.
    "ggx_levels",
    "level_of_alpha",
    # The material: a sum of lobes and a diffuse part, by channel.
    "Channels",
    "CosineLobe",
    "LUMINANCE",
    "Lobe",
    "MIRROR",
    "Material",
    "Microfacet",
    "Radiance",
    "Reflectance",
    "Sampler",
    "merge_channels",
    "widen",
    # The light under lobes that are round about a direction, and what they return to a view.
    "ROUND_LOBES",
    "RoundCosine",
    "RoundGGX",
    "RoundGaussian",
    "RoundLobe",
    "RoundShape",
    "Weight",
    "ViewTable",
    "sum_over_level",
    "sum_over_tree",
    "tabulate",
    # The scene: the points to shade, and the occluder that hides light from them.
    "Occluder",
    "ShadingPoints",
    "View",
    "occluder_of",
    "pair_points",
    "tangent",
    "unhidden",
    "valid_pairs",
    # Kernels: pure functions of points, run over all points, eagerly or compiled.
    "Kernel",
    "PerPoint",
    "kernel",
    "over_points",
    # Stages and samples that methods share, and the diffuse part.
    "FilteredSamples",
    "albedos",
    "diffuse_radiance",
    "filtered_samples",
    "irradiance",
    "pyramid",
    "visible_diffuse",
    # Regions of the light, and their shadows.
    "NoShadows",
    "Partition",
    "Shadows",
    "Visibility",
    "median_cut",
    "no_shadows",
    "shadows",
    "make_whole",
    # Maps filtered into cosine lobes, one for each region.
    "Energy",
    "LOBE_FILTERS",
    "LobeFilter",
    "LobeLevels",
    "LobeSum",
    "Maps",
    "N_ANGLES",
    "N_AZIMUTHS",
    "PartialMaps",
    "REACH",
    "TEXEL_BYTES",
    "Volume",
    "build_partial_maps",
    "calibrate",
    "cube_bytes",
    "lobe_radiance",
    "lobe_sums",
    "match_levels",
    "n_lookups",
    "no_lobe_sums",
    "window_taps",
    # The lighting function of a virtual cube, its factorization, and estimates of the truth.
    "FactorMap",
    "Floats",
    "LightingSamples",
    "Solver",
    "TexelWeight",
    "anisotropy",
    "average_start",
    "estimates",
    "factorize",
    "grid_laplacian",
    "grid_rows",
    "neighbour_laplacian",
    "sample_lighting_function",
    "weight_rows",
]
