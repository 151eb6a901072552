"""Finding splats like a given one: by colour anywhere, or by colour and connection from it outwards."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float32, Int64
from numpy import ndarray
from scipy.spatial import KDTree

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.shown_means import compute_shown_means
from instdrive_core.edits.queries.splat_values import find_plain_colors

REACH = 3.0
"""A splat touches those within so many times the usual distance to the nearest neighbours around the first one."""
USUAL_NEIGHBORS = 64
"""Splats around the first one that say what distance is usual."""


def find_alike_rows(document: Document, row: int, tolerance: float, time: float) -> Int64[ndarray, " m"]:
    """Find the drawn splats whose colour is within `tolerance` (0 … 1) of a splat's, each channel of it."""
    _, drawn = compute_shown_means(document, time)
    return np.flatnonzero(_find_alike(document, row, tolerance) & drawn)


def find_flooded_rows(document: Document, row: int, tolerance: float, time: float) -> Int64[ndarray, " m"]:
    """Find the drawn splats of like colour that hang together with a splat, by steps from neighbour to neighbour.

    How far a step may go follows from how dense splats lie around the first one.
    """
    means, drawn = compute_shown_means(document, time)
    rows = np.flatnonzero(_find_alike(document, row, tolerance) & drawn & np.isfinite(means).all(axis=1))
    if not len(rows) or not (rows == row).any():
        return np.array([row], np.int64)
    tree, places = KDTree(means[rows], balanced_tree=False), means[rows]
    around = tree.query(means[row], k=min(USUAL_NEIGHBORS, len(rows)))[1]
    nearest = tree.query(places[np.atleast_1d(around)], k=min(3, len(rows)))[0]
    step = REACH * float(np.median(np.atleast_2d(nearest)[:, -1]))
    reached = np.zeros(len(rows), np.bool_)
    border = np.searchsorted(rows, [row])
    reached[border] = True
    while len(border):
        touched = np.unique(np.concatenate([np.asarray(near) for near in tree.query_ball_point(places[border], step)]))
        border = touched[~reached[touched]]
        reached[border] = True
    return rows[reached]


def _find_alike(document: Document, row: int, tolerance: float) -> Bool[ndarray, " n"]:
    colors: Float32[ndarray, "n 3"] = find_plain_colors(document)
    return (np.abs(colors - colors[row]) <= tolerance).all(axis=1)
