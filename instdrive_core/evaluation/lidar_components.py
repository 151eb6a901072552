"""A trivial control: what hangs together in the LiDAR is one object. It needs no masks and learns nothing."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float32, UInt32
from numpy import ndarray
from scipy import ndimage
from scipy.spatial import KDTree

from instdrive_core.datasets.clip import Clip
from instdrive_core.maths.cells import connect_cells
from instdrive_core.scene.box_search import find_box_of_points
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.track import interpolate_tracks

VOXEL = 0.25
"""Metres: points in neighbouring cells of this size hang together."""
GROUND_CELL, GROUND_HEIGHT = 1.0, 0.3
"""Points up to this height above the lowest of their surroundings (3 × 3 cells, metres) are ground, one component."""
BOX_MARGIN = 0.1
MAX_SWEEPS = 20
"""More training sweeps than this are sampled evenly."""


def assign_component_ids(scene: Scene, clip: Clip) -> UInt32[ndarray, " n"] | None:
    """Give each Gaussian an ID: an actor's that of its node, others that of the nearest point's component.

    Points of the training sweeps are joined, those in boxes of moving objects left out. None without LiDAR.
    """
    points = _gather_standing_points(clip)
    if not len(points):
        return None
    cells = np.unique(np.floor(points / VOXEL).astype(np.int64), axis=0)
    centers = ((cells + 0.5) * VOXEL).astype(np.float32)
    ground = _is_ground(centers)
    components = np.ones(len(cells), np.uint32)
    components[~ground] = connect_cells(cells[~ground]) + 2
    ids = scene.nodes.astype(np.uint32) + components.max()
    background = scene.nodes == 0
    if background.any():
        _, nearest = KDTree(centers).query(scene.gaussians.means[background], workers=-1)
        ids[background] = components[nearest]
    return ids


def _gather_standing_points(clip: Clip) -> Float32[ndarray, "n 3"]:
    sweeps = clip.training_sweeps
    parts = [np.zeros((0, 3), np.float32)]
    for sweep in sweeps[:: max(1, -(-len(sweeps) // MAX_SWEEPS))]:
        points = sweep.load().points
        moving = [track for track in clip.tracks if track.moving and track.covers(sweep.time)]
        poses = interpolate_tracks(moving, sweep.time)
        dimensions = np.array([track.dimensions for track in moving]).reshape(-1, 3)
        parts.append(points[find_box_of_points(points, poses, dimensions, BOX_MARGIN) < 0])
    return np.concatenate(parts)


def _is_ground(points: Float32[ndarray, "n 3"]) -> Bool[ndarray, " n"]:
    columns = np.floor(points[:, :2] / GROUND_CELL).astype(np.int64)
    columns -= columns.min(axis=0)
    lowest = np.full(columns.max(axis=0) + 1, np.inf, np.float32)
    np.minimum.at(lowest, tuple(columns.T), points[:, 2])
    lowest = ndimage.minimum_filter(lowest, 3, mode="constant", cval=np.inf)
    return points[:, 2] - lowest[tuple(columns.T)] < GROUND_HEIGHT
