"""How strongly surfaces return light: learned from the points of a clip's own sweeps that lie on each splat."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32
from numpy import ndarray
from scipy.spatial import KDTree

from instdrive_core.datasets.clip import Clip
from instdrive_core.progress import report
from instdrive_core.scene.scene import Scene, place_in_world
from instdrive_core.sweeps.offsets import choose_evenly

_NEAR = 0.3
"""Metres between a point and the centre of the splat that it counts for."""
_MOST_SWEEPS = 12
"""Sweeps that are looked at, evenly over the drive."""
_USUAL = 0.2
"""Intensity where no sweep says anything."""


def learn_intensities(scene: Scene, clip: Clip) -> Float32[ndarray, " n"]:
    """Learn the intensity of each splat in [0, 1]: the mean of the points nearest to it.

    Splats without a point get the mean of their instance, and where that has none, of all. Held-out sweeps say nothing.

    Args:
        scene: with its tracks, in the world of the clip's origin.
        clip: whose sweeps have intensities.
    """
    sums, counts = np.zeros(len(scene)), np.zeros(len(scene))
    chosen = choose_evenly(clip.training_sweeps, _MOST_SWEEPS)
    still = np.flatnonzero(scene.nodes == 0)
    tree = KDTree(scene.gaussians.means[still]) if len(still) else None
    shift = clip.origin - scene.origin
    for done, sweep in enumerate(chosen):
        found = sweep.load()
        points = found.points + shift
        _count_nearest(tree, still, points, found.intensity, sums, counts)
        moved = np.flatnonzero(scene.nodes)
        if len(moved):
            poses, present = scene.find_node_poses(sweep.time)
            rows = moved[present[scene.nodes[moved]] > 0]
            if len(rows):
                gaussians = scene.gaussians
                means, _ = place_in_world(gaussians.means[rows], gaussians.quats[rows], scene.nodes[rows], poses)
                _count_nearest(KDTree(means), rows, points, found.intensity, sums, counts)
        report((done + 1) / len(chosen))
    return _fill(sums, counts, scene.instance_ids)


def _count_nearest(
    tree: KDTree | None, rows: ndarray, points: ndarray, intensity: ndarray, sums: ndarray, counts: ndarray
) -> None:
    if tree is None or not len(points):
        return
    found = tree.query(points, distance_upper_bound=_NEAR, workers=-1)
    distances, nearest = np.asarray(found[0]), np.asarray(found[1])
    met = np.isfinite(distances)
    np.add.at(sums, rows[nearest[met]], intensity[met])
    np.add.at(counts, rows[nearest[met]], 1)


def _fill(sums: ndarray, counts: ndarray, ids: ndarray) -> Float32[ndarray, " n"]:
    usual = sums.sum() / counts.sum() if counts.any() else _USUAL
    _, group = np.unique(ids, return_inverse=True)
    known = np.bincount(group, counts)
    of_group = np.where(known > 0, np.bincount(group, sums) / np.maximum(known, 1), usual)
    return np.where(counts > 0, sums / np.maximum(counts, 1), of_group[group]).astype(np.float32)
