"""A mesh under a camera: one shading point for each pixel whose centre shows it."""

import json
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field
from torch import Tensor

from glossbench.directions import Vec3, vec3
from glossbench.errors import InputError
from glossbench.process.surroundings import settled
from glossbench.scene.camera import frame_vertices
from glossbench.scene.mesh import Mesh
from glossbench.scene.mesh_files import READERS, identify_mesh, make_named_mesh
from glossbench.scene.points import VIEWS, ShadingPoints, View, check_pixels

# n . wo to which a shading normal is bent if interpolation turned it away from the viewer: for smaller values materials
# are almost mirrors.
LEAST_COSINE = 0.01

Floats = NDArray[np.float64]


class VisiblePoints(NamedTuple):
    """The result of a camera: the mask (H, W) and the points of its pixels."""

    mask: Tensor
    points: ShadingPoints


def resolve_view(text: str) -> tuple[str, dict[str, Any]]:
    """The view that one word means: a registered name, or the path of a mesh file with its option."""
    of_file = Path(text).suffix.lower() in READERS and text not in VIEWS.names()
    return ("mesh", {"shape": text}) if of_file else (text, {})


@VIEWS.register("mesh")
class MeshView(View):
    """A triangle mesh with smooth normals, framed by a camera; the mesh shadows itself.

    A pixel shows the first point that the ray through its centre hits. n is interpolated between the vertices and
    turned to the visible side; if it still faces away from the viewer, it is bent to n . wo = 0.01. The tangent is the
    mesh's own, made orthogonal to n; if the mesh has none, it is along circles of latitude as on the sphere,
    t = up x n / |up x n|. b = n x t. Light from behind the triangle is hidden, as by every opaque surface: with large
    triangles smooth shading ends at their outlines.

    Attributes:
        shape: cloth, torus_knot or bowl; a mesh of the catalogue: spot, teapot or bunny; or a file, .obj, .ply, .glb,
            .gltf or .stl: a relative path is searched in the current folder, the folder of the study and below
            GLOSSBENCH_DATA.
        resolution: rows of pixels.
        width: columns of pixels; by default as many as rows.
        camera: "orthographic", parallel rays, or "perspective", rays from one point.
        fov: angle across the shorter edge of a perspective image [degrees].
        azimuth: angle of the camera from the front (+z) to the right (+x) [degrees].
        elevation: angle of the camera above the horizon [degrees].
        zoom: magnification about the middle; 1 shows the whole mesh with a margin of a fortieth of the shorter edge.
    """

    shape: str = "torus_knot"
    resolution: Annotated[int, Field(ge=1, le=8192)] = 256
    width: Annotated[int, Field(ge=1, le=8192)] | None = None
    camera: Literal["perspective", "orthographic"] = "perspective"
    fov: Annotated[float, Field(ge=1, le=150)] = 30.0
    azimuth: Annotated[float, Field(ge=-360, le=360)] = 30.0
    elevation: Annotated[float, Field(ge=-90, le=90)] = 30.0
    zoom: Annotated[float, Field(ge=0.01, le=1000)] = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_pixels(self, self.resolution, self.width or self.resolution)

    @classmethod
    def file_of(cls, option: str, value: str) -> str | None:
        """The mesh file; names of meshes, which have no extension, are not files."""
        return "mesh file" if option == "shape" and Path(value).suffix else None

    def open_files(self) -> None:
        """The mesh."""
        _ = self._mesh

    def mask(self) -> Tensor:
        """Whether the ray through each pixel's centre hits the mesh, (H, W)."""
        return self._seen.mask

    def points(self) -> ShadingPoints:
        """One shading point for each pixel of the mask, with its position and the normal of its triangle."""
        return self._seen.points

    def scene(self) -> Mesh:
        """The mesh itself, the same for all cameras."""
        return self._mesh

    def key(self) -> str:
        """The key of the mesh, and the options of the camera."""
        camera = {k: v for k, v in self.as_dict().items() if k != "shape"}
        return f"mesh:{identify_mesh(self.shape)}:{json.dumps(camera, sort_keys=True)}"

    def notes(self) -> tuple[str, ...]:
        """The repairs of the mesh."""
        return tuple(f"mesh {self.shape}: {repair}" for repair in self._mesh.repairs)

    @cached_property
    def _mesh(self) -> Mesh:
        return make_named_mesh(self.shape)

    @cached_property
    @settled()
    def _seen(self) -> VisiblePoints:
        height, width = self.resolution, self.width or self.resolution
        mesh = self._mesh
        fov = self.fov if self.camera == "perspective" else None
        camera = frame_vertices(mesh.vertices, width / height, self.azimuth, self.elevation, fov, self.zoom)
        origins, directions = camera.rays(height, width)
        hits = mesh.rays.first_hit(origins, directions)
        hit = hits.face >= 0
        if not hit.any():
            raise InputError(f"mesh: no pixel shows {self.shape!r}; use a zoom of at least 1 pixel")
        points = make_shading_points(mesh, hits.face[hit], hits.barycentric[hit], -directions[hit])
        return VisiblePoints(torch.from_numpy(hit.reshape(height, width)), points)


def make_shading_points(mesh: Mesh, face: NDArray[np.int32], barycentric: Floats, wo: Floats) -> ShadingPoints:
    """Shading points of a mesh, for directions wo (P, 3) to the viewer."""
    corners = mesh.faces[face]

    def interpolate(values: Floats) -> Floats:
        return np.einsum("pk,pkc->pc", barycentric, values[corners])

    ng = _turn_to_viewer(mesh.face_normals(face), wo)
    n = interpolate(mesh.normals)
    n = np.where(_dot(n, n) > 1e-12, n, ng)  # interpolated normals may cancel
    n = _normalize(n * np.where(_dot(n, ng) < 0, -1, 1))
    c = _dot(n, wo)
    sideways = _normalize(n - c * wo)
    n = np.where(c < LEAST_COSINE, LEAST_COSINE * wo + (1 - LEAST_COSINE**2) ** 0.5 * sideways, n)
    up, right = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])
    t = np.cross(up, n) if mesh.tangents is None else interpolate(mesh.tangents)
    t = t - _dot(t, n) * n
    # At a pole all tangents are equally good: x is used, and y if n is x itself.
    for other in (right, up):
        t = np.where(_dot(t, t) > 1e-12, t, other - _dot(other[None], n) * n)
    t = _normalize(t)
    frame = (t, np.cross(n, t), n, wo, interpolate(mesh.vertices), ng)
    return ShadingPoints(*(_vec3(v) for v in frame))


def _vec3(v: Floats) -> Vec3:
    return Vec3(*(c.contiguous() for c in vec3(torch.from_numpy(v).float())))


def _dot(a: Floats, b: Floats) -> Floats:
    return (a * b).sum(1, keepdims=True)


def _normalize(v: Floats) -> Floats:
    return v / np.maximum(np.sqrt(_dot(v, v)), 1e-30)


def _turn_to_viewer(n: Floats, wo: Floats) -> Floats:
    return np.where(_dot(n, wo) < 0, -n, n)
