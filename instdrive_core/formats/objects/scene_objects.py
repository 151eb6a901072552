"""A scene's instances as objects: where they stand, how large they are, how they move."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray

from instdrive_core.instances.oriented_box import OrientedBox, compute_convex_hull, find_main_parts, fit_upright_box
from instdrive_core.instances.table import Instance
from instdrive_core.maths.activations import sigmoid
from instdrive_core.maths.groups import split_by_group
from instdrive_core.maths.rotations import matrix_from_quaternion, normalize_quaternions
from instdrive_core.scene.scene import Scene, place_in_world
from instdrive_core.scene.track import Track

SOLID = 0.1
"""Fainter Gaussians shape an object only where it has no four others."""
FORWARD = math.pi / 2
"""Yaw, in a track's frame, of where the object heads."""
HULL_SLACK = 1e-3
"""Share of the box's longest side by which corners of the hull may leave the box."""

Hull = tuple[Float64[ndarray, "v 3"], Int64[ndarray, "f 3"]]
"""Corners and triangles, counter-clockwise from outside."""


@dataclass(frozen=True)
class SceneObject:
    """One instance at one moment; positions relative to the scene's origin, in its unit, z up."""

    instance: Instance
    count: int
    """Splats."""
    track: Track | None
    """The track that it moves with; None where it stands still."""
    present: bool
    """Whether its track covers the moment; where not, it stands where the track begins or ends."""
    box: OrientedBox
    """With a track, x points forward; else along the longer side, one way or the other."""
    bounds: OrientedBox
    """The axis-aligned box (yaw 0)."""
    box_in_track: OrientedBox | None
    """The box in the track's frame (x right, y forward, z up), its x forward: the same at any moment."""
    hull: Hull | None
    """None where none was asked for, or the splats span no volume."""


def find_scene_objects(scene: Scene, time: float, hulls: bool = False) -> tuple[SceneObject, ...]:
    """Find the objects of all instances that have a splat with finite values, in the order of their IDs.

    Floaters, faint splats and the farthest 2 % at each face do not count (`instances.oriented_box`).
    """
    poses, present = scene.find_node_poses(time)
    found = []
    for instance, rows in _group_rows(scene):
        kept = select_shaping_rows(scene, rows)
        if not len(kept):
            continue
        node = int(np.bincount(scene.nodes[rows]).argmax())
        kept = kept[scene.nodes[kept] == node]
        if not len(kept):
            continue
        track = scene.actors[node - 1] if node else None
        means, covariances = _collect_in_world(scene, kept, poses)
        yaw = None if track is None else _compute_heading(poses[node])
        box = fit_upright_box(means, covariances, yaw)
        inside = box.holds(means, HULL_SLACK * float(box.size.max()))
        found.append(
            SceneObject(
                instance=instance,
                count=len(rows),
                track=track,
                present=bool(present[node]),
                box=box,
                bounds=fit_upright_box(means, covariances, 0.0),
                box_in_track=fit_upright_box(*collect_in_node(scene, kept), FORWARD) if track is not None else None,
                hull=compute_convex_hull(means[inside]) if hulls else None,
            )
        )
    return tuple(found)


def choose_unique_names(objects: Sequence[SceneObject], reserved: Collection[str] = ()) -> list[str]:
    """Choose the instances' names; one that is empty, taken or reserved gets its ID."""
    taken, names = set(reserved), []
    for entry in objects:
        instance = entry.instance
        name = instance.name or f"instance {instance.id}"
        while name in taken:
            name = f"{name} ({instance.id})"
        taken.add(name)
        names.append(name)
    return names


def _group_rows(scene: Scene) -> Iterator[tuple[Instance, Int64[ndarray, " k"]]]:
    for instance_id, rows in split_by_group(scene.instance_ids):
        if instance_id in scene.table:
            yield scene.table[instance_id], rows


def select_shaping_rows(scene: Scene, rows: Int64[ndarray, " k"]) -> Int64[ndarray, " m"]:
    """Select those of an instance's rows that say where it is: finite, solid, and no floaters."""
    gaussians = scene.gaussians
    numbers = (gaussians.means[rows], gaussians.quats[rows], gaussians.log_scales[rows])
    # Above 80 the scale is no float32 any more; a quaternion of 0 has no direction.
    finite = np.all([np.isfinite(array).all(axis=1) for array in numbers], axis=0)
    finite &= (gaussians.log_scales[rows] < 80).all(axis=1) & (np.abs(gaussians.quats[rows]).max(axis=1) > 1e-6)
    rows = rows[finite]
    solid = rows[sigmoid(gaussians.opacity_logits[rows]) >= SOLID]
    rows = solid if len(solid) >= 4 else rows
    return rows[find_main_parts(gaussians.means[rows].astype(np.float64))] if len(rows) else rows


def collect_in_node(
    scene: Scene, rows: Int64[ndarray, " k"]
) -> tuple[Float64[ndarray, "k 3"], Float64[ndarray, "k 3 3"]]:
    """Collect means (metres) and covariances of rows, in their nodes' frames."""
    gaussians = scene.gaussians
    return gaussians.means[rows].astype(np.float64), _compute_covariances(
        gaussians.quats[rows], gaussians.log_scales[rows]
    )


def _collect_in_world(
    scene: Scene, rows: Int64[ndarray, " k"], poses: Float64[ndarray, "m 4 4"]
) -> tuple[Float64[ndarray, "k 3"], Float64[ndarray, "k 3 3"]]:
    gaussians = scene.gaussians
    means, quats = place_in_world(gaussians.means[rows], gaussians.quats[rows], scene.nodes[rows], poses)
    return means.astype(np.float64), _compute_covariances(quats, gaussians.log_scales[rows])


def _compute_covariances(quats: ndarray, log_scales: ndarray) -> Float64[ndarray, "k 3 3"]:
    axes = (
        matrix_from_quaternion(normalize_quaternions(quats.astype(np.float64)))
        * np.exp(log_scales.astype(np.float64))[:, None]
    )
    return axes @ axes.swapaxes(1, 2)


def _compute_heading(world_from_box: Float64[ndarray, "4 4"]) -> float:
    """Yaw of a track's forward axis."""
    return math.atan2(world_from_box[1, 1], world_from_box[0, 1])
