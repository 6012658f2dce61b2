"""Winding: if neighbouring triangles traverse their common edge in opposite directions, normals are on one side."""

import numpy as np
from numpy.typing import NDArray


def find_reversed_faces(faces: NDArray[np.int64]) -> NDArray[np.bool_]:
    """The smallest set of faces (F, 3) to reverse so that all connected faces have the same winding, as a mask (F,).

    Faces are connected by edges that belong to exactly two faces. The graph has two nodes per face, as it is and
    reversed, and an edge joins the nodes that agree: one component holds one choice for all its faces, another the
    opposite choice. If both are the same component, the surface is one-sided like a Moebius strip, and its faces stay.
    """
    from scipy.sparse import coo_array  # late, as few runs have a mesh, and both take a fifth of a second to import
    from scipy.sparse.csgraph import connected_components

    n = len(faces)
    edges = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    low, high = edges.min(1), edges.max(1)
    order = np.lexsort((high, low))
    starts = np.flatnonzero(np.r_[True, (np.diff(low[order]) != 0) | (np.diff(high[order]) != 0)])
    pairs = starts[np.diff(np.r_[starts, len(order)]) == 2]
    one, other = order[pairs], order[pairs + 1]
    alike = (edges[one, 0] == edges[other, 0]).astype(np.int64)  # same direction of the edge: reverse one of both
    one, other = one // 3, other // 3
    rows, columns = np.r_[one, one + n], np.r_[other + n * alike, other + n * (1 - alike)]
    graph = coo_array((np.ones(len(rows), dtype=bool), (rows, columns)), shape=(2 * n, 2 * n))
    _, labels = connected_components(graph, directed=False)
    as_is, turned = labels[:n], labels[n:]
    body = np.minimum(as_is, turned)
    turn = (as_is != body) & (as_is != turned)
    share = np.bincount(body, turn) / np.maximum(np.bincount(body), 1)
    return np.where(as_is == turned, False, turn ^ (share[body] > 0.5))
