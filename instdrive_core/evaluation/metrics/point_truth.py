"""Ground truth in 3D: the object that each LiDAR point of a held-out sweep lies on."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float32, Int64, UInt8, UInt32
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, Frame, Sweep, SweepPoints, is_held_out
from instdrive_core.masks.annotated.labelled_cloud import (
    NOTHING,
    UNKNOWN,
    assign_boxes,
    assign_class_ids,
    find_fitting_classes,
)
from instdrive_core.masks.ground_truth import GroundTruth, GroundTruthInstance
from instdrive_core.scene.track import interpolate_tracks

MIN_POINTS = 50
"""Objects with fewer points in all held-out sweeps together are ignored."""
INSIDE_OF_MOVING = -2
"""What `assign_boxes` says of points inside of a moving box that do not belong to it."""


@dataclass(frozen=True)
class LabelledSweep:
    """The points of one held-out sweep that a camera of the run has in view."""

    time: float
    """Seconds, as the clip counts them."""
    points: Float32[ndarray, "n 3"]
    """World coordinates in metres."""
    truth: UInt32[ndarray, " n"]
    """IDs of the ground truth; 0 = ignored."""


def label_sweeps(clip: Clip, ground_truth: GroundTruth) -> list[LabelledSweep]:
    """Label every held-out sweep with the IDs that the label maps use; none where the clip has no held-out sweep or no
    labels for points.

    Exact where the clip stores an instance per point. Else a point inside a box takes the box's object if its
    semantic class fits (the box's lowest 0.12 m, where the road is, left out), and any other point its class, or
    its region of that where the ground truth tells regions apart. Points of movable classes outside of all boxes, and
    what the second LiDAR sees of moving objects, are ignored.

    Points that no held-out photo of the same time step has in its image (ego vehicle left out) are left out: a run
    with the front camera alone is not asked for what is behind it.

    Raises DataError where a sweep is damaged.
    """
    sweeps = []
    for sweep in clip.sweeps:
        frames = [frame for frame in clip.held_out_frames if frame.view.index == sweep.index]
        if not is_held_out(sweep.index) or not frames:
            continue
        found = sweep.load()
        labels = _label_points(clip, sweep, found, ground_truth)
        if labels is not None:
            seen = is_in_view(found.points, frames)
            sweeps.append(LabelledSweep(sweep.time, found.points[seen], labels[seen]))
    return _drop_tiny_objects(sweeps)


def is_in_view(points: Float32[ndarray, "n 3"], frames: Iterable[Frame]) -> Bool[ndarray, " n"]:
    """Whether points project into a valid pixel of any photo; occluders are not considered."""
    seen = np.zeros(len(points), bool)
    for frame in frames:
        camera = frame.view.camera
        pixels, depths = camera.project(points)
        inside = camera.contains(pixels, depths, 0.0)
        if frame.valid is not None:
            columns, rows = np.floor(pixels[inside]).astype(np.int64).T
            inside[inside] = frame.valid[rows, columns]
        seen |= inside
    return seen


def _label_points(
    clip: Clip, sweep: Sweep, found: SweepPoints, ground_truth: GroundTruth
) -> UInt32[ndarray, " n"] | None:
    if ground_truth.source == "exact":
        return found.instance_labels
    if found.classes is None:
        return None
    if isinstance(ground_truth, StuffOfPoints):
        ids = ground_truth.find_stuff(found.points, found.classes).astype(np.int64)
    else:
        ids = _find_stuff_by_class(clip, found.classes, ground_truth.instances)
    return _put_into_boxes(clip, sweep.time, found, ids, ground_truth.instances)


@runtime_checkable
class StuffOfPoints(Protocol):
    """A ground truth that tells regions of stuff of one class apart."""

    def find_stuff(self, points: Float32[ndarray, "n 3"], classes: UInt8[ndarray, " n"]) -> UInt32[ndarray, " n"]:
        """Find the region that points with semantic classes lie on; 0 = none."""
        ...


def _find_stuff_by_class(
    clip: Clip, classes: UInt8[ndarray, " n"], instances: Mapping[int, GroundTruthInstance]
) -> Int64[ndarray, " n"]:
    stuff_ids = {instance.class_name: instance.id for instance in instances.values() if instance.kind == "stuff"}
    ids = assign_class_ids(clip.class_names, stuff_ids)[classes]
    ids[ids == NOTHING] = UNKNOWN
    return ids


def _put_into_boxes(
    clip: Clip,
    time: float,
    found: SweepPoints,
    ids: Int64[ndarray, " n"],
    instances: Mapping[int, GroundTruthInstance],
) -> UInt32[ndarray, " n"]:
    """Give points inside a box whose class fits to its object, and leave out what is inside a moving one without
    fitting."""
    assert found.classes is not None
    thing_ids = {instance.track_id: instance.id for instance in instances.values() if instance.track_id is not None}
    boxes = [track for track in clip.tracks if track.covers(time) and track.id in thing_ids]
    box, _ = assign_boxes(
        found.points,
        found.classes,
        found.sensor,
        interpolate_tracks(boxes, time),
        np.array([track.dimensions / 2 for track in boxes]).reshape(-1, 3),
        np.array([track.moving for track in boxes], bool),
        np.array([find_fitting_classes(clip.class_names, track.label) for track in boxes]).reshape(-1, 256),
    )
    ids[box == INSIDE_OF_MOVING] = UNKNOWN
    inside = box >= 0
    ids[inside] = np.array([thing_ids[track.id] for track in boxes], np.int64)[box[inside]]
    return ids.astype(np.uint32)


def _drop_tiny_objects(sweeps: list[LabelledSweep]) -> list[LabelledSweep]:
    """Set objects under `MIN_POINTS` in all sweeps together to 0."""
    if not sweeps:
        return []
    ids, counts = np.unique(np.concatenate([sweep.truth for sweep in sweeps]), return_counts=True)
    tiny = ids[counts < MIN_POINTS]
    return [replace(sweep, truth=np.where(np.isin(sweep.truth, tiny), np.uint32(0), sweep.truth)) for sweep in sweeps]
