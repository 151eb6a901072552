"""Names of learned instances: the class that cuboids and LiDAR semantics give each, where the clip has them."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numba
import numpy as np
from jaxtyping import Float32, UInt8, UInt16, UInt32
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, Sweep
from instdrive_core.instances.neighbors import build_forest
from instdrive_core.scene.box_search import find_box_of_points

_POINTS_PER_SWEEP = 10_000
_MAX_DISTANCE = 0.3
"""Metres between a LiDAR point and the Gaussian whose instance it votes for."""
_MIN_VOTES = 3
_BOX_MARGINS = 0.2, -0.1
"""Metres by which a parked object's box is grown, and its lower face: a negative one cuts the road off."""


def find_instance_classes(
    clip: Clip,
    instance_ids: UInt32[ndarray, " n"],
    means: Float32[ndarray, "n 3"],
    nodes: UInt16[ndarray, " n"],
    actor_labels: list[str],
) -> dict[int, str]:
    """Find the class name of each instance ID; IDs that nothing votes for are left out.

    Actors take their track's label. Background instances take the label of a parked object's box that holds more
    than half of their Gaussians, else the majority class of the labelled LiDAR points nearest to them.
    """
    classes = _classes_by_lidar(clip, instance_ids, means, nodes)
    classes |= _classes_by_parked_boxes(clip, instance_ids, means, nodes)
    for node, label in enumerate(actor_labels, start=1):
        for instance_id in np.unique(instance_ids[nodes == node]).tolist():
            if instance_id:
                classes[instance_id] = label
    return classes


def make_display_names(instance_ids: UInt32[ndarray, " n"], classes: dict[int, str]) -> dict[int, str]:
    """Make a name for each ID: its class, or `instance`, with the ID."""
    ids = np.unique(instance_ids)
    return {i: f"{classes.get(i, 'instance')} {i}" for i in ids[ids > 0].tolist()}


def _classes_by_lidar(
    clip: Clip, instance_ids: UInt32[ndarray, " n"], means: Float32[ndarray, "n 3"], nodes: UInt16[ndarray, " n"]
) -> dict[int, str]:
    """The class of most LiDAR points that are nearest to one of the ID's Gaussians; the lowest of equals."""
    background = np.flatnonzero((nodes == 0) & np.isfinite(means).all(axis=1))
    points, labels = _load_labelled_points(clip)
    if not len(background) or not len(points):
        return {}
    forest = build_forest(means[background], np.zeros(len(background), np.int64))
    one_tree, reach = np.zeros(len(points), np.int64), np.full(len(points), _MAX_DISTANCE)
    nearest = forest.find_nearest(points, one_tree, 1, reach)[1][:, 0]
    near = nearest >= 0
    ids = instance_ids[background[nearest[near]]].astype(np.int64)
    pairs, counts = np.unique((ids << 8) | labels[near], return_counts=True)
    winners: dict[int, tuple[int, str]] = {}
    for pair, count in zip(pairs.tolist(), counts.tolist(), strict=True):
        instance_id, label = pair >> 8, pair & 0xFF
        if instance_id and label in clip.class_names and count > winners.get(instance_id, (0, ""))[0]:
            winners[instance_id] = count, clip.class_names[label]
    return {instance_id: name for instance_id, (count, name) in winners.items() if count >= _MIN_VOTES}


def _load_labelled_points(clip: Clip) -> tuple[Float32[ndarray, "p 3"], UInt8[ndarray, " p"]]:
    """Load points of each training sweep that has classes, and the classes, thinned."""
    with ThreadPoolExecutor(max_workers=numba.get_num_threads()) as readers:
        parts = [part for part in readers.map(_load_thinned_sweep, clip.training_sweeps) if part is not None]
    if not parts:
        return np.zeros((0, 3), np.float32), np.zeros(0, np.uint8)
    return np.concatenate([points for points, _ in parts]), np.concatenate([labels for _, labels in parts])


def _load_thinned_sweep(sweep: Sweep) -> tuple[Float32[ndarray, "p 3"], UInt8[ndarray, " p"]] | None:
    loaded = sweep.load()
    if loaded.classes is None:
        return None
    step = max(1, len(loaded.points) // _POINTS_PER_SWEEP)
    return loaded.points[::step], loaded.classes[::step]


def _classes_by_parked_boxes(
    clip: Clip, instance_ids: UInt32[ndarray, " n"], means: Float32[ndarray, "n 3"], nodes: UInt16[ndarray, " n"]
) -> dict[int, str]:
    parked = [track for track in clip.tracks if not track.moving]
    if not parked:
        return {}
    sizes = np.bincount(instance_ids)
    poses = np.stack([track.world_from_box[len(track.times) // 2] for track in parked])
    dimensions = np.stack([track.dimensions for track in parked])
    # Most Gaussians lie in no box at all: one quick pass leaves few for the boxes one by one, which may overlap.
    boxed = np.flatnonzero((nodes == 0) & (find_box_of_points(means, poses, dimensions, *_BOX_MARGINS) >= 0))
    near, ids = means[boxed], instance_ids[boxed]
    classes: dict[int, str] = {}
    for number, track in enumerate(parked):
        alone = slice(number, number + 1)
        inside = find_box_of_points(near, poses[alone], dimensions[alone], *_BOX_MARGINS) >= 0
        counts = np.bincount(ids[inside], minlength=len(sizes))
        for instance_id in np.flatnonzero(counts * 2 > sizes).tolist():
            if instance_id:
                classes[instance_id] = track.label
    return classes
