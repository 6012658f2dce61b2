"""The reference of meshes that shadow themselves against Mitsuba 3: its own rays, shadow rays and smooth normals."""

from functools import cache
from tempfile import NamedTemporaryFile

import numpy as np
import pytest
import trimesh

import glossbench as gb
from glossbench.directions import Vec3
from glossbench.scene import rays as rays_module
from glossbench.scene.camera import frame_vertices
from glossbench.scene.mesh import Mesh
from glossbench.scene.mesh_view import LEAST_COSINE
from glossbench.truth import sampling as ground_truth
from glossbench.truth.reference import compute_reference
from oracles.mitsuba_agreement import check_agreement, light_of, their_light
from oracles.mitsuba_side import N_RENDERS, PAIRS, diffuse, ggx, mi

RESOLUTION = 14
MATERIALS = {
    "diffuse": (("kurt", {"ks": 0.0, "kd": (0.8, 0.5, 0.2)}), lambda: diffuse((0.8, 0.5, 0.2))),
    "ggx": (("ggx", {"alpha": 0.4, "f0": (0.9, 0.6, 0.2)}), lambda: ggx((0.4, 0.4), (0.9, 0.6, 0.2))),
}
CASES = [
    ("bowl", "perspective", "diffuse", "gradient"),
    ("torus_knot", "perspective", "diffuse", "spots"),
    ("torus_knot", "orthographic", "ggx", "gradient"),
    ("bowl", "orthographic", "ggx", "spots"),
]


def view_of(shape, camera):
    return gb.view("mesh", shape=shape, camera=camera, resolution=RESOLUTION, azimuth=20.0, elevation=40.0)


def compared(view):
    """Pixels (P,) whose interpolated normal faces the viewer: the others Mitsuba leaves black, and we bend."""
    points = view.points()
    cos_o = sum(a * b for a, b in zip(points.n, points.wo, strict=True)).numpy()
    return cos_o > LEAST_COSINE + 1e-4


@cache
def theirs(shape, camera, material, light):
    """Radiance (S, P, 3) of Mitsuba's renders of the view's pixels, each ray through its pixel's centre."""
    view = view_of(shape, camera)
    mesh = view.scene()
    stated = trimesh.Trimesh(mesh.vertices, mesh.faces, vertex_normals=mesh.normals, process=False)
    with NamedTemporaryFile(suffix=".ply") as file:
        stated.export(file.name, vertex_normal=True)
        surface = mi.load_dict({"type": "ply", "filename": file.name, "bsdf": MATERIALS[material][1]()})
    scene = mi.load_dict({"type": "scene", "mesh": surface, "light": their_light(light)})
    direct = mi.load_dict({"type": "direct", "emitter_samples": PAIRS, "bsdf_samples": PAIRS})
    sampler = mi.load_dict({"type": "independent"})
    fov = view.fov if camera == "perspective" else None
    seen = frame_vertices(mesh.vertices, 1.0, view.azimuth, view.elevation, fov, view.zoom)
    origins, directions = seen.rays(RESOLUTION, RESOLUTION)
    pixels = np.flatnonzero(view.mask().numpy().reshape(-1))[compared(view)]
    rays = [mi.RayDifferential3f(mi.Ray3f(list(origins[i]), list(directions[i]))) for i in pixels]
    images = []
    for seed in range(N_RENDERS):
        sampler.seed(seed, 1)
        images.append([direct.sample(scene, sampler, ray)[0] for ray in rays])
    return np.array(images, dtype=np.float64)


def ours(shape, camera, material, light):
    """Radiance and standard error (P, 3)."""
    view = view_of(shape, camera)
    name, options = MATERIALS[material][0]
    truth = compute_reference(
        light_of(light), gb.material(name, **options), view, relative_error=3e-3, max_samples=8192
    )
    seen = compared(view)
    return truth.radiance[truth.mask].numpy()[seen], truth.standard_error[truth.mask].numpy()[seen]


@pytest.mark.parametrize(("shape", "camera", "material", "light"), CASES)
def test_reference_of_a_mesh_is_the_image_of_mitsuba(shape, camera, material, light):
    radiance, standard_error = ours(shape, camera, material, light)

    assert compared(view_of(shape, camera)).mean() > 0.95
    check_agreement(radiance, standard_error, theirs(shape, camera, material, light), len(CASES))


def no_shadow_rays(monkeypatch):
    monkeypatch.setattr(ground_truth, "unhidden", lambda weight, points, d, occluder: weight)


def an_offset_too_big(monkeypatch):
    """A tenth of the mesh: the thickness of the bowl's side is half of it."""
    monkeypatch.setattr(rays_module, "OFFSET", 0.1)


def a_flipped_normal(monkeypatch):
    right = Mesh.visible
    monkeypatch.setattr(
        Mesh, "visible", lambda self, position, ng, direction: right(self, position, Vec3(*(-c for c in ng)), direction)
    )


@pytest.mark.parametrize("fault", [no_shadow_rays, an_offset_too_big, a_flipped_normal])
def test_agreement_notices(fault, monkeypatch):
    fault(monkeypatch)

    radiance, standard_error = ours(*CASES[0])

    with pytest.raises(AssertionError), np.errstate(divide="ignore", invalid="ignore"):
        check_agreement(radiance, standard_error, theirs(*CASES[0]), len(CASES))
