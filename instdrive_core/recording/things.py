"""Things of a scene with a box each, in the frame that they move with."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float64, Int32, Int64
from numpy import ndarray

from instdrive_core.edits.document.document import Document
from instdrive_core.formats.objects.scene_objects import FORWARD, collect_in_node, select_shaping_rows
from instdrive_core.instances.oriented_box import OrientedBox, fit_upright_box
from instdrive_core.instances.table import Instance
from instdrive_core.masks.export.coco_panoptic import STUFF
from instdrive_core.maths.groups import split_by_group
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.track import Track, find_points_inside
from instdrive_core.scene.transforms import Similarity, extract_scale

LONGEST = 30.0
"""Metres: what is longer and has no class is a surface, no thing."""
MAIN_SHARE = 0.5
"""Share of an actor's splats from which an instance is the actor, and takes its track's box."""
INSIDE = 0.6
"""Share of an instance's splats that must lie in an annotated box for the instance to take it."""
MARGIN = 0.2
"""Metres outside an annotated box that still count as inside: splats have a width, and boxes are drawn tightly."""

Source = Literal["track", "annotation", "splats"]


@dataclass(frozen=True)
class Thing:
    """An instance and its box. The box frame: origin at the centre, x right, y forward, z up."""

    instance: Instance
    node: int
    """Node that it moves with; 0 stands still."""
    dimensions: Float64[ndarray, "3"]
    """Width, length and height in metres."""
    node_from_box: Float64[ndarray, "4 4"]
    source: Source
    """Where the box is from: the actor's track, an annotation of the clip, or fitted to the splats."""
    heads: bool
    """Whether y points where it heads; of boxes fitted to what stands still it is the longer side, either way."""
    rows: Int64[ndarray, " k"]
    """Splats that shape it: no floaters, nothing faint."""


def is_stuff(instance: Instance) -> bool:
    """Whether an instance is a surface or a plant, by its class, or where that is unknown by its size."""
    low, high = np.array(instance.bounds)
    return instance.class_name in STUFF or (not instance.class_name and float((high - low)[:2].max()) > LONGEST)


def find_moves(document: Document) -> dict[int, Similarity]:
    """Find how edits have moved each instance that they moved, [s R | t] in its node's frame, by ID.

    Of an instance whose parts were moved apart it is what most of its splats do.
    """
    entries, ids = document.transforms.indices, document.scene.instance_ids
    moved = np.unique(ids[entries > 0])
    rows = np.flatnonzero(np.isin(ids, moved) & (ids > 0))
    found = {}
    for instance_id in moved[moved > 0].tolist():
        entry = int(np.bincount(entries[rows[ids[rows] == instance_id]]).argmax())
        if entry:
            found[instance_id] = document.transforms.get_move(entry)
    return found


def find_boxed_things(
    scene: Scene, moves: Mapping[int, Similarity] | None = None, annotated: Sequence[Track] = ()
) -> tuple[Thing, ...]:
    """Find all things of a scene with at least one splat that shapes them, in the order of their IDs.

    Args:
        scene: the scene as edited.
        moves: what `find_moves` found: boxes of tracks and annotations move along.
        annotated: boxes of the drive's annotations, relative to the scene's origin, for what stands still.
    """
    standing = [track for track in annotated if not track.moving]
    found = []
    for instance_id, rows in split_by_group(scene.instance_ids):
        if not instance_id or instance_id not in scene.table or is_stuff(scene.table[instance_id]):
            continue
        node = int(np.bincount(scene.nodes[rows]).argmax())
        rows = select_shaping_rows(scene, rows[scene.nodes[rows] == node])
        if len(rows):
            move = None if moves is None else moves.get(instance_id)
            main = node > 0 and len(rows) >= MAIN_SHARE * _count_shaping(scene, node)
            found.append(_build_thing(scene, scene.table[instance_id], node, rows, move, main, standing))
    return tuple(found)


def label_groups(things: Sequence[Thing], count: int) -> Int32[ndarray, " n"]:
    """Label each of `count` splats with the place of the thing that it shapes; -1 for none."""
    groups = np.full(count, -1, np.int32)
    for place, thing in enumerate(things):
        groups[thing.rows] = place
    return groups


def _count_shaping(scene: Scene, node: int) -> int:
    """Count a node's splats that shape it: faint ones say nothing of who the actor is."""
    return len(select_shaping_rows(scene, np.flatnonzero(scene.nodes == node)))


def _build_thing(
    scene: Scene,
    instance: Instance,
    node: int,
    rows: Int64[ndarray, " k"],
    move: Similarity | None,
    main: bool,
    standing: Sequence[Track],
) -> Thing:
    if main:
        track = scene.actors[node - 1]
        pose, dimensions = _move_box(np.eye(4), track.dimensions, move)
        return Thing(instance, node, dimensions, pose, "track", True, rows)
    means, covariances = collect_in_node(scene, rows)
    if not node:
        unmoved = means if move is None else (means - move[:, 3]) @ move[:, :3] / extract_scale(move) ** 2
        track = _find_annotated(unmoved, standing)
        if track is not None:
            pose, dimensions = _move_box(track.world_from_box[len(track.times) // 2], track.dimensions, move)
            return Thing(instance, 0, dimensions, pose, "annotation", True, rows)
    box = fit_upright_box(means, covariances, FORWARD if node else None)
    return Thing(instance, node, box.size[[1, 0, 2]], _face_forward(box), "splats", node > 0, rows)


def _face_forward(box: OrientedBox) -> Float64[ndarray, "4 4"]:
    """The pose of a box whose x becomes y, the way things head."""
    pose = np.eye(4)
    turn = box.yaw - math.pi / 2
    pose[:2, :2] = [[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]]
    pose[:3, 3] = box.center
    return pose


def _find_annotated(means: Float64[ndarray, "k 3"], standing: Sequence[Track]) -> Track | None:
    """The annotated box that most of the splats lie in; None where in none lie enough."""
    best, most = None, INSIDE
    for track in standing:
        pose = track.world_from_box[len(track.times) // 2]
        if np.linalg.norm(np.median(means, axis=0) - pose[:3, 3]) > float(np.linalg.norm(track.dimensions)):
            continue
        share = float(np.mean(find_points_inside(means, pose, track.dimensions, MARGIN)))
        if share > most:
            best, most = track, share
    return best


def _move_box(
    pose: Float64[ndarray, "4 4"], dimensions: Float64[ndarray, "3"], move: Similarity | None
) -> tuple[Float64[ndarray, "4 4"], Float64[ndarray, "3"]]:
    if move is None:
        return pose.copy(), np.asarray(dimensions, np.float64)
    scale = extract_scale(move)
    moved = np.eye(4)
    moved[:3, :3] = move[:, :3] / scale @ pose[:3, :3]
    moved[:3, 3] = move[:, :3] @ pose[:3, 3] + move[:, 3]
    return moved, np.asarray(dimensions, np.float64) * scale
