"""The drive as a stage: its things stand where a request places them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from jaxtyping import Int64
from numpy import ndarray

from instdrive_core.maths.rotations import matrix_from_quaternion, quaternion_from_matrix
from instdrive_core.recording.things import Thing
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.track import Track
from instdrive_core.serving.requests import FrameSpan, Limits, RequestError, read_pose_pair

Unnamed = Literal["drive", "gone"]
"""What moving things do that a request does not name."""
_BOX_FROM_OBJECT = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
"""From forward, left, up, as requests have it, to the box's right, forward, up."""
_LISTED = 8
"""Things that an error names."""


@dataclass(frozen=True)
class Staged:
    """A thing that can be placed."""

    thing: Thing
    node: int
    """Its own node; 0 where it stands still and shares the background's."""
    rows: Int64[ndarray, " k"]
    """All its splats, where it has no node."""


@dataclass(frozen=True)
class Stage:
    """A scene and its things by every name that they answer to."""

    scene: Scene
    things: Mapping[str, Staged]
    unnamed: Unnamed = "drive"

    def place(self, objects: Sequence[Any], frame: FrameSpan, limits: Limits) -> Scene:
        """Place things for a frame; what stands still and is not named stays.

        Args:
            objects: DynamicObject messages: the boxes' poses, x forward, y left, z up.

        Raises RequestError for things that there are not, that are named twice, or whose poses are wrong.
        """
        if len(objects) > limits.objects:
            raise RequestError("dynamic_objects", f"{len(objects)} objects long", f"send at most {limits.objects}")
        scene, placed = self.scene, set[int]()
        nodes, actors = scene.nodes, list(scene.actors)
        if self.unnamed == "gone":
            actors = [replace(track, times=np.full(len(track.times), np.inf)) for track in actors]
        for number, message in enumerate(objects):
            field = f"dynamic_objects[{number}]"
            staged = self._find(field, message.track_id)
            if staged.thing.instance.id in placed:
                raise RequestError(f"{field}.track_id", repr(message.track_id), "name each thing once")
            placed.add(staged.thing.instance.id)
            track = _follow(field, message, staged.thing, frame)
            if staged.node:
                actors[staged.node - 1] = track
            else:
                if nodes is scene.nodes:
                    nodes = nodes.copy()
                actors.append(track)
                nodes[staged.rows] = len(actors)
        return replace(scene, nodes=nodes, actors=tuple(actors))

    def _find(self, field: str, name: str) -> Staged:
        staged = self.things.get(name)
        if staged is None:
            known = sorted({staged.thing.instance.id for staged in self.things.values()})
            listed = ", ".join(map(str, known[:_LISTED])) + (", …" if len(known) > _LISTED else "")
            remedy = f"name a thing by the editor's ID ({listed or 'there are none'}); `instdrive objects` lists them"
            raise RequestError(f"{field}.track_id", repr(name), remedy)
        return staged


def build_stage(scene: Scene, things: Sequence[Thing], unnamed: Unnamed = "drive") -> Stage:
    """Build the stage of a scene; its things answer to the editor's ID, the track's ID, and names that only they have.

    What shares an actor's node without being the actor, such as a rider, goes with it and is not placed by itself.
    """
    found: dict[str, Staged] = {}
    names = [thing.instance.name for thing in things]
    for thing in things:
        if thing.node and thing.source != "track":
            continue
        of_thing = scene.instance_ids == thing.instance.id
        staged = Staged(thing, thing.node, np.flatnonzero(of_thing & (scene.nodes == thing.node)))
        found[str(thing.instance.id)] = staged
        for name in (scene.actors[thing.node - 1].id if thing.node else "", thing.instance.name):
            if name and names.count(name) <= 1:
                found.setdefault(name, staged)
    return Stage(scene, found, unnamed)


def find_object_pose(scene: Scene, thing: Thing, time: float) -> ndarray:
    """Find the pose (4 × 4) with which a request would leave a thing where it is at `time` (seconds)."""
    poses, _ = scene.find_node_poses(time)
    return poses[thing.node] @ thing.node_from_box @ _BOX_FROM_OBJECT


def _follow(field: str, message: Any, thing: Thing, frame: FrameSpan) -> Track:
    """The way of a thing's node during a frame."""
    pair = read_pose_pair(f"{field}.pose_pair", message.pose_pair)
    node_from_object = thing.node_from_box @ _BOX_FROM_OBJECT
    object_from_node = np.linalg.inv(node_from_object)
    if frame.end > frame.start:
        times, poses = [frame.start, frame.end], [pair.start, pair.end]
    else:
        times, poses = [frame.start], [pair.middle]
    name = f"instance {thing.instance.id}"
    ways = _straighten(np.stack(poses) @ object_from_node)
    return Track(name, thing.instance.class_name, thing.dimensions, np.array(times), ways, True)


def _straighten(poses: ndarray) -> ndarray:
    """Poses whose turns are exactly turns again, after products of rounded numbers."""
    poses = poses.copy()
    poses[:, :3, :3] = matrix_from_quaternion(quaternion_from_matrix(poses[:, :3, :3]))
    return poses
