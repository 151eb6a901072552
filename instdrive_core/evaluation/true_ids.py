"""The bound that instance learning can reach on given geometry: every Gaussian with its true ID."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import groupby

import numpy as np
from jaxtyping import Float32, Integer, UInt32
from numpy import ndarray
from scipy.sparse import csr_array, find
from scipy.spatial import KDTree

from instdrive_core.datasets.clip import Frame
from instdrive_core.evaluation.metrics.world_gaussians import WorldGaussians, place_world_gaussians
from instdrive_core.masks.ground_truth import GroundTruth
from instdrive_core.maths.streams import Stream, make_generator
from instdrive_core.rasterize.kernels.blend_weights import compute_blend_weights
from instdrive_core.scene.scene import Scene

PIXELS_PER_VIEW = 8192
MIN_WEIGHT = 0.1
"""Gaussians with less blending weight in all sampled pixels count as unseen: what shines through a surface in front
of them would name them after that surface."""


def find_true_ids(
    scene: Scene,
    frames: Sequence[Frame],
    ground_truth: GroundTruth,
    seed: int = 0,
    pixels_per_view: int = PIXELS_PER_VIEW,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> UInt32[ndarray, " n"]:
    """Find each Gaussian's true ID: the one whose labelled pixels it contributes most blending weight to.

    Weights are summed over `pixels_per_view` seeded random labelled pixels of every frame (ties: the lower ID).
    Unseen Gaussians, with less than `MIN_WEIGHT` in all, take the ID of the nearest seen one of their node; 0 where
    there is none.
    """
    shape = (len(scene), max(ground_truth.instances, default=0) + 1)
    votes = csr_array(shape, dtype=np.float64)
    done = 0
    for time, group in groupby(frames, key=lambda frame: frame.view.time):
        world = place_world_gaussians(scene, time)
        parts = []
        for frame in group:
            rng = make_generator(seed, Stream.ORACLE_PIXELS, done)
            parts.append(_collect_votes(world, frame, ground_truth.load(frame).ravel(), pixels_per_view, rng))
            done += 1
            progress(done, len(frames))
        rows, labels, weights = (np.concatenate(column) for column in zip(*parts, strict=True))
        votes += csr_array((weights.astype(np.float64), (rows, labels)), shape=shape)
    return _fill_from_nearest(_choose_most_voted(votes, len(scene)), scene)


def _collect_votes(
    world: WorldGaussians, frame: Frame, labels: UInt32[ndarray, " p"], count: int, rng: np.random.Generator
) -> tuple[Integer[ndarray, " m"], UInt32[ndarray, " m"], Float32[ndarray, " m"]]:
    """Collect Gaussians, IDs and blending weights of `count` random labelled pixels."""
    labelled = np.flatnonzero(labels)
    pixels = np.sort(rng.choice(labelled, min(count, len(labelled)), replace=False))
    found = compute_blend_weights(
        world.means, world.quats, world.log_scales, world.opacities, frame.view.camera, pixels
    )
    return found.rows, np.repeat(labels[pixels], np.diff(found.indptr)), found.weights


def _choose_most_voted(votes: csr_array, count: int) -> UInt32[ndarray, " n"]:
    """Choose the ID with the largest weight in each of `count` rows; 0 where the row's sum is below `MIN_WEIGHT`."""
    rows, columns, weights = find(votes)
    order = np.lexsort((columns, np.negative(weights), rows))
    seen, first = np.unique(rows[order], return_index=True)
    ids = np.zeros(count, np.uint32)
    ids[seen] = columns[order][first]
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
