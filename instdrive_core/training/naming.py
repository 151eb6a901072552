"""What each learned instance is called: the class that cuboids and LiDAR semantics give it, where the clip has them."""

from __future__ import annotations

from collections import Counter

import numpy as np
from jaxtyping import Float32, UInt16, UInt32
from numpy import ndarray
from scipy.spatial import KDTree

from instdrive_core.datasets.clip import Clip
from instdrive_core.scene.track import points_inside

_POINTS_PER_SWEEP = 10_000
_MAX_DISTANCE = 0.3
"""Metres between a LiDAR point and the Gaussian whose instance it votes for."""
_MIN_VOTES = 3


def instance_classes(
    clip: Clip,
    instance_ids: UInt32[ndarray, " n"],
    means: Float32[ndarray, "n 3"],
    nodes: UInt16[ndarray, " n"],
    actor_labels: list[str],
) -> dict[int, str]:
    """Class name by instance ID; IDs that nothing votes for are left out.

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


def display_names(instance_ids: UInt32[ndarray, " n"], classes: dict[int, str]) -> dict[int, str]:
    """A name for each ID: its class, or `instance`, with the ID."""
    ids = np.unique(instance_ids)
    return {i: f"{classes.get(i, 'instance')} {i}" for i in ids[ids > 0].tolist()}


def _classes_by_lidar(
    clip: Clip, instance_ids: UInt32[ndarray, " n"], means: Float32[ndarray, "n 3"], nodes: UInt16[ndarray, " n"]
) -> dict[int, str]:
    background = np.flatnonzero(nodes == 0)
    if not len(background):
        return {}
    tree = KDTree(means[background])
    votes: dict[int, Counter[int]] = {}
    for sweep in clip.training_sweeps():
        points = sweep.load()
        if points.classes is None:
            continue
        step = max(1, len(points.points) // _POINTS_PER_SWEEP)
        distances, nearest = tree.query(points.points[::step], distance_upper_bound=_MAX_DISTANCE, workers=-1)
        near = np.isfinite(distances)
        ids, labels = instance_ids[background[np.asarray(nearest)[near]]], points.classes[::step][near]
        pairs, counts = np.unique(np.stack([ids, labels.astype(np.uint32)]), axis=1, return_counts=True)
        for instance_id, label, count in zip(*pairs.tolist(), counts.tolist(), strict=True):
            if instance_id and label in clip.class_names:
                votes.setdefault(instance_id, Counter())[label] += count
    winners = {instance_id: counter.most_common(1)[0] for instance_id, counter in votes.items()}
    return {i: clip.class_names[label] for i, (label, count) in winners.items() if count >= _MIN_VOTES}


def _classes_by_parked_boxes(
    clip: Clip, instance_ids: UInt32[ndarray, " n"], means: Float32[ndarray, "n 3"], nodes: UInt16[ndarray, " n"]
) -> dict[int, str]:
    background = nodes == 0
    sizes = np.bincount(instance_ids)
    classes: dict[int, str] = {}
    for track in clip.tracks:
        if track.moving:
            continue
        middle = track.world_from_box[len(track.times) // 2]
        inside = points_inside(means, middle, track.dimensions, margin=0.2, bottom=-0.1) & background
        counts = np.bincount(instance_ids[inside], minlength=len(sizes))
        for instance_id in np.flatnonzero(counts * 2 > sizes).tolist():
            if instance_id:
                classes[instance_id] = track.label
    return classes
