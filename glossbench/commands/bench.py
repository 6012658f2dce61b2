"""Measure this machine: the shading kernel, pyramids and memory, with ratios between values of the same run."""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from functools import partial
from typing import Any, get_args

import torch
from torch import Tensor

from glossbench.brdf.cook_torrance import CookTorrance
from glossbench.brdf.kurt import FreeShadowing, Kurt
from glossbench.brdf.lobe import Lobe
from glossbench.commands.bench_drjit import drjit_version, filtered_samples_in_drjit
from glossbench.commands.bench_kernels import method_calls, rates
from glossbench.directions import Vec3, points_2d, stack, to_local, vec3
from glossbench.envmap.cubemap import CubeMap
from glossbench.envmap.lights.synthetic import Spots
from glossbench.envmap.pyramid import Pyramid, weighted_radiance
from glossbench.prefilter.filtered_samples import filtered_samples
from glossbench.prefilter.light_shadows import build_variance_shadow_maps
from glossbench.prefilter.lighting_function import sample_lighting_function, texel_weights
from glossbench.prefilter.median_cut import median_cut
from glossbench.prefilter.pyramids import MipFilter, build_pyramid
from glossbench.scene.points import ShadingPoints
from glossbench.scene.shapes import cloth
from glossbench.scene.sphere import Sphere
from glossbench.scene.virtual_cube import pair_points, valid_pairs, virtual_directions
from glossbench.shading.kernels import kernel, over_points
from glossbench.shading.kernels.backend import always, choosing, never
from glossbench.shading.kernels.build import has_compiler
from glossbench.shading.method import METHODS, order_stages
from glossbench.truth.reference import ReferenceMethod, compute_reference

SAMPLES, CUBE, VIEW, REGIONS = 32, 256, 128, 64


@dataclass(frozen=True)
class Line:
    """One measurement: what is measured, its value with unit, and its ratio to the value that it is compared with."""

    what: str
    value: str
    ratio: str = ""


def measure(tell: Callable[[str], None]) -> Iterator[Line]:
    """All measurements; `tell` is called with the name of each before it begins. The first run compiles the kernels."""
    tell("shading kernel")
    yield from _measure_kernels()
    tell("the kernels of all methods")
    yield from _measure_methods()
    tell("sampling the lighting function")
    yield from _measure_lighting()
    tell("reference")
    yield from _measure_references()
    tell("pyramids of a 1024 cube")
    yield from _measure_pyramid(1024)
    tell(f"{REGIONS} partial maps of a {CUBE} cube, and their shadow maps")
    yield from _measure_partial_maps()
    tell("peak memory of a 512^2 sphere at 270 samples")
    yield _measure_memory()


def _measure_kernels() -> list[Line]:
    points = Sphere(resolution=VIEW).points()
    pyramid = build_pyramid(Spots(resolution=CUBE).cubemap(), "box")
    lobe = Kurt(m=(0.15, 0.15)).reflectance().lobes[0]
    samples = lobe.sample_points(points_2d(SAMPLES))
    level = torch.tensor(-2.5)
    arguments = (lobe, samples, pyramid, level)
    pairs = len(points) * SAMPLES
    plain = _measure_rate(lambda: _sum_directly(points, lobe, samples, pyramid, level), pairs)
    with choosing(never):
        eager = _measure_rate(lambda: over_points(_sum_filtered, points, SAMPLES, *arguments), pairs)
    what = f"filtered importance sampling, {SAMPLES} samples, {CUBE} cube, {VIEW}^2 sphere"
    lines = [
        Line(f"{what}: straightforward eager", f"{plain:.1f} M samples/s", "1"),
        Line(f"{what}: chunked eager", f"{eager:.1f} M samples/s", f"{eager / plain:.1f}"),
    ]
    if has_compiler():
        with choosing(always):
            compiled = _measure_rate(lambda: over_points(_sum_filtered, points, SAMPLES, *arguments), pairs)
        lines.append(Line(f"{what}: compiled", f"{compiled:.1f} M samples/s", f"{compiled / plain:.1f}"))
    if (installed := drjit_version()) is None:
        return [*lines, Line(f"{what}: Dr.Jit", "not measured: it or LLVM is not installed")]
    assert isinstance(lobe, FreeShadowing)
    drjit = _measure_rate(filtered_samples_in_drjit(points, lobe, samples, pyramid, level), pairs)
    return [*lines, Line(f"{what}: Dr.Jit {installed}", f"{drjit:.1f} M samples/s", f"{drjit / plain:.1f}")]


def _measure_methods() -> list[Line]:
    """The first kernel of each method, compiled, compared with itself run eagerly."""
    lines = []
    for name, call, pairs in method_calls(CUBE, VIEW, SAMPLES) if has_compiler() else ():
        found, what = rates(call, pairs), f"{name}, {call.kernel.name}: compiled, compared with eager"
        value = f"{found[1]:.1f} M pairs/s" if found else "not compiled"
        lines.append(Line(what, value, f"{found[1] / found[0]:.1f}" if found else ""))
    return lines


@kernel("bench_filtered_samples")
def _sum_filtered(points: ShadingPoints, lobe: Lobe, samples: Any, pyramid: Pyramid, level: Tensor) -> Tensor:
    """Filtered samples of an unoccluded light."""
    _, d, lod, weight = filtered_samples(points, lobe, samples, pyramid, level)
    return weighted_radiance(pyramid, d, lod, weight)


def _sum_directly(points: ShadingPoints, lobe: Lobe, samples: Any, pyramid: Pyramid, level: Tensor) -> Tensor:
    """The same sum as a textbook writes it: (P, N, 3) tensors, one gather per tap, no chunks."""
    columns = points.columns(0, len(points))
    wi, pdf, weight = lobe.sample(columns.wo_local(), samples)
    frame = torch.stack([stack(columns.t), stack(columns.b), stack(columns.n)], dim=-2)
    d = (stack(wi)[..., None, :] @ frame)[..., 0, :]
    components = Vec3(d[..., 0], d[..., 1], d[..., 2])
    lod = level + 0.5 * (pyramid.log2_texels_per_sr(components) - torch.log2(pdf))
    rows, shares = pyramid.taps(components, lod)
    radiance = torch.zeros_like(d)
    for row, share in zip(rows, shares, strict=True):
        radiance = radiance + pyramid.texels[row.long()] * share[..., None]
    return (radiance * weight[0][..., None]).sum(dim=1)


def _measure_lighting() -> list[Line]:
    """Terms f L g cos per second, for a virtual cube of 8, a light of 32: one by one, and by the cube's rotations."""
    light, material = Spots(resolution=32).cubemap(), CookTorrance(m=(0.3, 0.3), f0=(0.95, 0.64, 0.54))
    normals = torch.arange(0, 384, 48)
    terms = len(valid_pairs(8)) * 6 * 32**2
    plain = _measure_rate(
        lambda: [_sum_term_by_term(light, material, 8, int(n)) for n in normals], terms * len(normals) // 384, 1
    )
    with choosing(never):
        ours = _measure_rate(lambda: sample_lighting_function(light, material, 8, 32), terms, 1)
    what = "lighting function, Cook-Torrance, virtual cube of 8, light of 32"
    lines = [
        Line(f"{what}: term by term, eager", f"{plain:.1f} M terms/s", "1"),
        Line(f"{what}: one normal for 24, eager", f"{ours:.1f} M terms/s", f"{ours / plain:.1f}"),
    ]
    if has_compiler():
        with choosing(always):
            compiled = _measure_rate(lambda: sample_lighting_function(light, material, 8, 32), terms, 1)
        lines.append(
            Line(f"{what}: one normal for 24, compiled", f"{compiled:.1f} M terms/s", f"{compiled / plain:.1f}")
        )
    return lines


def _measure_references() -> list[Line]:
    """The reference by sampling and as a sum, to the same stated error, and the sum to a much smaller one."""
    light, material, view = Spots(resolution=CUBE).cubemap(), Kurt(m=(0.15, 0.15)), Sphere(resolution=32)
    seconds: list[float] = []
    lines = []
    runs: list[tuple[ReferenceMethod, float]] = [("sampling", 1e-2), ("summation", 1e-2), ("summation", 1e-4)]
    for method, error in runs:
        seconds.append(_measure_seconds(partial(compute_reference, light, material, view, error, method=method), 1))
        what = f"reference, Beckmann 0.15, {CUBE} cube, 32^2 sphere, {method} to {100 * error:g} %"
        lines.append(Line(what, f"{seconds[-1]:.2f} s", f"{seconds[-1] / seconds[0]:.3f}"))
    return lines


def _find_seen_views(edge: int, normal: int) -> Tensor:
    """Indices of the views above the horizon of a normal."""
    pairs = valid_pairs(edge)
    return pairs[pairs[:, 0] == normal, 1]


def _sum_term_by_term(light: CubeMap, material: CookTorrance, edge: int, normal: int) -> Tensor:
    """Lo of one normal and all its views as a textbook computes it: over all texels, with f evaluated for each pair."""
    views = _find_seen_views(edge, normal)
    points = pair_points(edge, torch.stack([torch.full_like(views, normal), views], 1)).columns(0, len(views))
    texels = vec3(virtual_directions(light.resolution).float()[None])
    wi = to_local(texels, points.t, points.b, points.n)
    weight = wi.z.clamp(min=0) * texel_weights(light.resolution, "exact").float()
    values = torch.stack([f * weight for f in material.reflectance().f(points.wo_local(), wi)], -1)
    return (values * light.faces.reshape(-1, 3)).sum(1)


def _measure_rate(work: Callable[[], Any], pairs: int, repeats: int = 10) -> float:
    """Million point-sample pairs per second, in the fastest of the repeats after a warm-up run."""
    return pairs / _measure_seconds(work, repeats) / 1e6


def _measure_seconds(work: Callable[[], Any], repeats: int) -> float:
    work()
    best = float("inf")
    for _ in range(repeats):
        started = time.perf_counter()
        work()
        best = min(best, time.perf_counter() - started)
    return best


def _measure_pyramid(resolution: int) -> list[Line]:
    light = Spots(resolution=resolution).cubemap()
    there = torch.empty_like(light.faces)
    copy = _measure_seconds(lambda: there.copy_(light.faces), 10)
    clone = _measure_seconds(light.faces.clone, 10)
    lines = [
        Line(f"copy of a {resolution} cube into memory that is there", f"{1000 * copy:.1f} ms", "1"),
        Line("copy of it into new memory", f"{1000 * clone:.1f} ms", f"{clone / copy:.1f}"),
    ]
    for mip_filter in get_args(MipFilter):
        build = partial(build_pyramid, light, mip_filter)
        for how, choose in (("eager", never), *([("compiled", always)] if has_compiler() else [])):
            with choosing(choose):
                seconds = _measure_seconds(build, 5)
            lines.append(
                Line(f"{mip_filter} pyramid of it: {how}", f"{1000 * seconds:.1f} ms", f"{seconds / copy:.1f}")
            )
    return lines


def _measure_partial_maps() -> list[Line]:
    """The maps of 64 regions, compared with plain pyramids of 64 whole cubes; and the shadow maps of the regions."""
    light = Spots(resolution=CUBE).cubemap()
    regions = median_cut(light, REGIONS)
    plain = REGIONS * _measure_seconds(lambda: build_pyramid(light, "box"), 5)
    lines = [Line(f"{REGIONS} box pyramids of a {CUBE} cube", f"{plain:.2f} s", "1")]
    for name, storage, maps in find_map_stages():
        seconds = _measure_seconds(lambda: maps(light, regions), 1)  # noqa: B023
        lines.append(Line(f"{REGIONS} maps of {name}, {storage}", f"{seconds:.2f} s", f"{seconds / plain:.1f}"))
    mesh = cloth(rows=187)
    seconds = _measure_seconds(lambda: build_variance_shadow_maps(mesh, regions.direction, regions.solid_angle), 1)
    return [*lines, Line(f"{REGIONS} shadow maps of 256^2, a mesh of {len(mesh.faces)} triangles", f"{seconds:.2f} s")]


def find_map_stages() -> Iterator[tuple[str, str, Callable[..., Any]]]:
    """(method, storage, stage `maps`) for each method that offers several storages of the maps of regions."""
    for cls in map(METHODS.get, METHODS.names()):
        options = {each.name: each.type for each in fields(cls)}
        for value in get_args(options.get("storage")) if "regions" in options else ():
            method = cls.create({"storage": value, "regions": REGIONS, "mip_filter": "sqrt_cosine"})
            yield cls.name, value, partial(order_stages(cls)["maps"].function, method)


def shade_large() -> Tensor:
    """Shade a 512^2 sphere under a 1024 cube with 270 samples per pixel: 56 million samples."""
    points, pyramid = Sphere(resolution=512).points(), build_pyramid(Spots().cubemap(), "gauss6")
    lobe = Kurt(m=(0.15, 0.15)).reflectance().lobes[0]
    samples = lobe.sample_points(points_2d(270))
    with choosing(never):
        return over_points(_sum_filtered, points, 270, lobe, samples, pyramid, torch.tensor(-4.0))


# Runs in a separate process, so that the peak is that of this work alone.
_MEMORY_PROBE = """
import resource, sys
from glossbench.commands.bench import shade_large
shade_large()
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(peak / (1024**2 if sys.platform == "darwin" else 1024))
"""


def _measure_memory() -> Line:
    what = "peak memory of a process that shades a 512^2 sphere at 270 samples under a 1024 cube"
    try:
        done = subprocess.run([sys.executable, "-c", _MEMORY_PROBE], capture_output=True, text=True, check=True)
    except subprocess.CalledProcessError as error:
        return Line(what, f"not measured: {error.stderr.strip().splitlines()[-1]}")
    return Line(what, f"{float(done.stdout):.0f} MB", "")
