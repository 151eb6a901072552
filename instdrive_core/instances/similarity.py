"""Gaussians that masks say nothing of take the group of a neighbour that looks alike: same colour, same facing."""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Bool, Float, Int64, UInt16
from numpy import ndarray
from scipy.spatial import KDTree

_BLOCK = 1 << 16
"""Gaussians that ask their neighbours in one go."""
_COLOR_SCALE = 0.25
"""Difference of colours (of 0 to 1 a channel) that counts as much as the distance to the farthest neighbour asked."""


def fill_from_similar(
    groups: Int64[ndarray, " n"],
    unknown: Bool[ndarray, " n"],
    means: Float[ndarray, "n 3"],
    colors: Float[ndarray, "n 3"],
    normals: Float[ndarray, "n 3"],
    nodes: UInt16[ndarray, " n"],
    neighbors: int,
) -> Int64[ndarray, " n"]:
    """Give unknown Gaussians the group of the nearby known one that is most similar in place, colour and normal.

    The cost of a neighbour is its distance over that of the farthest of the `neighbors` nearest ones, plus the
    difference in colour over 0.25, plus one minus the cosine between the normals.

    Args:
        groups: of each Gaussian; -1 = none, such neighbours are never asked.
        unknown: those to fill.
        means: metres.
        colors: RGB in [0, 1].
        normals: unit vectors of any sign.
        nodes: only Gaussians of the same node are asked.
        neighbors: how many nearest ones are compared.
    """
    filled = groups.copy()
    for node in np.unique(nodes[unknown]):
        known = np.flatnonzero((nodes == node) & ~unknown & (groups >= 0))
        rows = np.flatnonzero((nodes == node) & unknown)
        count = min(neighbors, len(known))
        if count == 0:
            continue
        tree = KDTree(means[known])
        for start in range(0, len(rows), _BLOCK):
            asking = rows[start : start + _BLOCK]
            distances, found = tree.query(means[asking], k=count, workers=numba.get_num_threads())
            distances, found = distances.reshape(len(asking), count), known[found.reshape(len(asking), count)]
            cost = distances / np.maximum(distances[:, -1:], 1e-6)
            cost += np.linalg.norm(colors[asking, None] - colors[found], axis=2) / _COLOR_SCALE
            cost += 1 - np.abs((normals[asking, None] * normals[found]).sum(axis=2))
            filled[asking] = groups[found[np.arange(len(asking)), np.argmin(cost, axis=1)]]
    return filled
