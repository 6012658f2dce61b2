"""A camera that looks at a mesh from any direction and frames it."""

from dataclasses import dataclass
from math import cos, radians, sin, tan

import numpy as np
from numpy.typing import NDArray

MARGIN = 0.05  # around the mesh, as a share of its half extent
BEHIND = 4.0  # start of the rays of an orthographic camera: behind every mesh within [-1, 1]
NEAREST = 0.1  # smallest distance of a perspective camera to a vertex, along its axis

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Camera:
    """Axes of the image in the world, and the area that it covers.

    Attributes:
        axes: directions to the right, up and back to the camera: rows of a rotation, (3, 3).
        middle: the point in the middle of the image, in axes; for a perspective camera its own position.
        half: half of the image's shorter edge: a length; for a perspective camera the tangent of half its angle.
        perspective: whether all rays start at one point; otherwise they are parallel.
    """

    axes: Floats
    middle: Floats
    half: float
    perspective: bool

    def rays(self, height: int, width: int) -> tuple[Floats, Floats]:
        """Origins and unit directions (H W, 3) through the centres of all pixels, row by row."""
        step = 2 * self.half / min(height, width)
        x = (np.arange(width) + 0.5 - width / 2) * step
        y = (height / 2 - 0.5 - np.arange(height)) * step
        grid = np.stack([*np.meshgrid(x, y), np.zeros((height, width))], axis=2).reshape(-1, 3)
        if self.perspective:
            directions = grid - [0, 0, 1]
            directions /= np.linalg.norm(directions, axis=1, keepdims=True)
            origins = np.broadcast_to(self.middle, grid.shape)
        else:
            directions = np.broadcast_to([0.0, 0.0, -1.0], grid.shape)
            origins = grid + self.middle + [0, 0, BEHIND]
        return origins @ self.axes, directions @ self.axes


def frame_vertices(
    vertices: Floats, aspect: float, azimuth: float, elevation: float, field_of_view: float | None, zoom: float
) -> Camera:
    """The camera that shows all vertices (V, 3) as large as the margin allows.

    Orthographic: the middle of the image is the middle of the vertices' extents. Perspective: the nearest position from
    which all vertices are inside the image, |x - x_0| <= (z_0 - z) tan for each vertex. With A = max(x + z tan) and
    B = max(z tan - x): z_0 = (A + B) / (2 tan), x_0 = (A - B) / 2; the axis with the larger z_0 decides.

    Args:
        aspect: columns / rows of the image.
        azimuth, elevation: angles of the camera [degrees].
        field_of_view: angle across the image's shorter edge [degrees]; None for an orthographic camera.
        zoom: magnification about the middle.
    """
    a, e = radians(azimuth), radians(elevation)
    right, back = np.array([cos(a), 0.0, -sin(a)]), np.array([sin(a) * cos(e), sin(e), cos(a) * cos(e)])
    axes = np.stack([right, np.cross(back, right), back])
    x, y, z = axes @ vertices.T
    # Half edges of the image without its margin; the shorter half edge with margin is 1.
    edges = np.array([max(aspect, 1), max(1 / aspect, 1)]) / (1 + MARGIN)
    if field_of_view is None:
        middle = np.array([(c.max() + c.min()) / 2 for c in (x, y)])
        half = max((c.max() - c.min()) / 2 / edge for c, edge in zip((x, y), edges, strict=True))
        return Camera(axes, np.array([*middle, 0.0]), float(half / zoom), perspective=False)
    slope = tan(radians(field_of_view) / 2)
    reach = [
        ((c + z * slope * k).max(), (z * slope * k - c).max(), slope * k) for c, k in zip((x, y), edges, strict=True)
    ]
    distance = max(z.max() + NEAREST, *((p + q) / (2 * s) for p, q, s in reach))
    middle = np.array([(p - q) / 2 for p, q, _ in reach])
    return Camera(axes, np.array([*middle, distance]), slope / zoom, perspective=True)
