"""The reference for instance learning on given geometry: every Gaussian with its true ID.

It looks at as many pixels of a photo as our own votes do, and is no bound: what votes for whole masks gives to an
object, single pixels may not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import groupby
from math import sqrt

import numpy as np
from jaxtyping import Int64, UInt32
from numpy import ndarray
from scipy.sparse import csr_array, find
from scipy.spatial import KDTree

from instdrive_core.datasets.clip import Frame
from instdrive_core.evaluation.metrics.world_gaussians import WorldGaussians, place_world_gaussians
from instdrive_core.rasterize.kernels.blend_weights import compute_blend_weights
from instdrive_core.scene.scene import Scene

PIXELS_PER_VIEW = 32_768
"""About so many pixels of a photo are looked at, on a grid that is shifted from photo to photo, as our votes do."""
MIN_WEIGHT = 0.1
"""Gaussians with less blending weight in all pixels looked at count as unseen: what shines through a surface in front
of them would name them after that surface."""


def find_true_ids(
    scene: Scene,
    frames: Sequence[Frame],
    load_ids: Callable[[Frame], UInt32[ndarray, "h w"]],
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> UInt32[ndarray, " n"]:
    """Find each Gaussian's true ID: the one whose pixels it contributes most blending weight to.

    Weights are summed over the labelled pixels of a grid in every frame (ties: the lower ID). Unseen Gaussians, with
    less than `MIN_WEIGHT` in all, take the ID of the nearest seen one of their node; 0 where there is none.

    Args:
        scene: the Gaussians.
        frames: photos to look at.
        load_ids: loads the true ID of each pixel at the frame's size; 0 = not known.
        progress: is told frames done and in all.
    """
    votes, done = csr_array((0, len(scene)), dtype=np.float64), 0
    for (time, lag), group in groupby(frames, key=lambda frame: (frame.view.time, frame.view.camera.lag)):
        world = place_world_gaussians(scene, time, lag)
        for frame in group:
            votes = _add_rows(votes, _collect_votes(world, frame, load_ids(frame), done), len(scene))
            done += 1
            progress(done, len(frames))
    return _fill_from_nearest(_choose_most_voted(votes, len(scene)), scene)


def _collect_votes(world: WorldGaussians, frame: Frame, ids: UInt32[ndarray, "h w"], number: int) -> csr_array:
    """Sum the blending weight of each Gaussian (columns) in the pixels of each ID (rows) on one frame's grid."""
    pixels = _choose_grid(ids, number)
    found = compute_blend_weights(
        world.means, world.quats, world.log_scales, world.opacities, frame.view.camera, pixels
    )
    weights = csr_array(
        (found.weights.astype(np.float64), found.rows, found.indptr), shape=(len(pixels), len(world.means))
    )
    ids_of_pixels = ids.ravel()[pixels].astype(np.int64)
    ones, shape = np.ones(len(pixels)), (int(ids_of_pixels.max(initial=-1)) + 1, len(pixels))
    return csr_array(csr_array((ones, (ids_of_pixels, np.arange(len(pixels)))), shape=shape) @ weights)


def _choose_grid(ids: UInt32[ndarray, "h w"], number: int) -> Int64[ndarray, " p"]:
    """Flat indices of the labelled pixels on the grid of the number-th frame, rising."""
    step = max(1, round(sqrt(ids.size / PIXELS_PER_VIEW)))
    shown = np.zeros(ids.shape, bool)
    grid = slice(number % step, None, step), slice(number // step % step, None, step)
    shown[grid] = ids[grid] > 0
    return np.flatnonzero(shown)


def _add_rows(sums: csr_array, more: csr_array, count: int) -> csr_array:
    """Add two matrices of `count` columns, of which either may lack the last rows."""
    rows = max(len(sums.indptr), len(more.indptr)) - 1
    for part in (sums, more):
        part.resize((rows, count))
    return csr_array(sums + more)


def _choose_most_voted(votes: csr_array, count: int) -> UInt32[ndarray, " n"]:
    """Choose the ID with the largest weight of each of `count` Gaussians; 0 where its sum is below `MIN_WEIGHT`."""
    labels, rows, weights = find(votes)
    order = np.lexsort((labels, np.negative(weights), rows))
    seen, first = np.unique(rows[order], return_index=True)
    ids = np.zeros(count, np.uint32)
    ids[seen] = labels[order][first]
    ids[np.bincount(rows, weights, minlength=count) < MIN_WEIGHT] = 0
    return ids


def _fill_from_nearest(ids: UInt32[ndarray, " n"], scene: Scene) -> UInt32[ndarray, " n"]:
    """Fill every 0 with the ID of the nearest Gaussian of the same node that has one."""
    filled = ids.copy()
    for node in np.unique(scene.nodes[ids == 0]):
        known = np.flatnonzero((scene.nodes == node) & (ids > 0))
        unknown = np.flatnonzero((scene.nodes == node) & (ids == 0))
        if len(known):
            _, nearest = KDTree(scene.gaussians.means[known]).query(scene.gaussians.means[unknown], workers=-1)
            filled[unknown] = ids[known[nearest]]
    return filled
