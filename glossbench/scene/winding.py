"""Winding: neighbouring triangles run their common edge in opposite directions, so that normals point to one side."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components


def against_the_rest(faces: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which faces (F, 3) to turn over so that all that hang together wind alike, (F,); as few as can be.

    Faces hang together over edges of exactly two. Each face counts as two nodes, as it is and turned over, and an edge
    joins those that agree: a component holds one choice for all its faces, and another the opposite one. Where both are
    the same component, the surface is one-sided as a Moebius strip: its faces stay.
    """
    n = len(faces)
    edges = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    low, high = edges.min(1), edges.max(1)
    order = np.lexsort((high, low))
    starts = np.flatnonzero(np.r_[True, (np.diff(low[order]) != 0) | (np.diff(high[order]) != 0)])
    pairs = starts[np.diff(np.r_[starts, len(order)]) == 2]
    one, other = order[pairs], order[pairs + 1]
    alike = (edges[one, 0] == edges[other, 0]).astype(np.int64)  # both run the edge alike: one of them must turn
    one, other = one // 3, other // 3
    rows, columns = np.r_[one, one + n], np.r_[other + n * alike, other + n * (1 - alike)]
    graph = coo_array((np.ones(len(rows), dtype=bool), (rows, columns)), shape=(2 * n, 2 * n))
    _, labels = connected_components(graph, directed=False)
    as_is, turned = labels[:n], labels[n:]
    body = np.minimum(as_is, turned)
    turn = (as_is != body) & (as_is != turned)
    share = np.bincount(body, turn) / np.maximum(np.bincount(body), 1)
    return np.where(as_is == turned, False, turn ^ (share[body] > 0.5))
