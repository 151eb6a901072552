"""What is drawn over the map: tracks and boxes of what moves, the recording car's way, where the user looks."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_app.state import Viewpoint
from instdrive_core.edits.document.document import Document
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.track import Track

LEAST_DRIVE = 0.5
"""Metres: what goes less far has no track on the map."""
SPACING = 0.5
"""Metres between the points of a track on the map, at least."""
MOST_PLACES = 20_000
"""Splats, spread evenly, by which the extent of a scene is found."""
SPREAD = (0.03, 0.97)
"""Shares between which splats lie that the map shows at first where the scene has no drive."""
AROUND = 15.0
"""Metres around the ways that the map shows at first."""


@dataclass(frozen=True)
class MapThing:
    """Something that has a track."""

    id: int
    """Its instance; of several, the first."""
    ids: tuple[int, ...]
    path: Float64[ndarray, "n 2"]
    """Where its middle drives, metres; empty where it stands."""
    box: Float64[ndarray, "4 2"] | None
    """Its footprint at the present time: right front, left front, left back, right back; None where it is not there."""


def list_map_things(document: Document, time: float) -> tuple[MapThing, ...]:
    """List what has a track and is shown: where it drives, and where it is at `time` (seconds)."""
    members: dict[int, list[int]] = {}
    for instance in document.scene.table:
        if instance.node and document.summarize_instance(instance.id).drawn:
            members.setdefault(instance.node, []).append(instance.id)
    things = []
    for node, ids in sorted(members.items()):
        track = document.scene.actors[node - 1]
        box = find_footprint(track, time) if track.covers(time) else None
        things.append(MapThing(ids[0], tuple(ids), thin_path(track), box))
    return tuple(things)


def find_footprint(track: Track, time: float) -> Float64[ndarray, "4 2"]:
    """Find the corners (metres) of a track's box on the ground: right front, left front, left back, right back."""
    return place_footprint(track.interpolate_pose(time), track.dimensions)


def place_footprint(pose: Float64[ndarray, "4 4"], size: Float64[ndarray, "3"]) -> Float64[ndarray, "4 2"]:
    """Place the corners (metres) of a box of this size and pose: right front, left front, left back, right back."""
    signs = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)], np.float64)
    return signs * size[:2] / 2 @ pose[:2, :2].T + pose[:2, 3]


def thin_path(track: Track) -> Float64[ndarray, "n 2"]:
    """Thin the way of a track to points some distance apart (metres); empty for what stands."""
    places = track.world_from_box[:, :2, 3]
    if track.compute_path_length() <= LEAST_DRIVE:
        return np.zeros((0, 2))
    gone = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))]
    rows = np.unique(np.r_[np.searchsorted(gone, np.arange(0.0, gone[-1], SPACING)), len(places) - 1])
    return places[rows]


def find_at(things: tuple[MapThing, ...], x: float, y: float) -> int:
    """Find the thing whose footprint holds a place (metres); 0 for none, the smallest of several."""
    found = [
        (float(np.linalg.norm(thing.box[0] - thing.box[2])), thing.id)
        for thing in things
        if thing.box is not None and holds_place(thing.box, x, y)
    ]
    return min(found)[1] if found else 0


def holds_place(box: Float64[ndarray, "4 2"], x: float, y: float) -> bool:
    """Whether a convex outline holds a place."""
    edges, to_place = np.roll(box, -1, axis=0) - box, np.array([x, y]) - box
    turns = edges[:, 0] * to_place[:, 1] - edges[:, 1] * to_place[:, 0]
    return bool((turns >= 0).all() or (turns <= 0).all())


def find_extent(
    document: Document, things: tuple[MapThing, ...], way: Float64[ndarray, "n d"] | None
) -> Float64[ndarray, "m 2"] | None:
    """Find places (metres) that a map shows at first: around the recording car's way, else the dense part of the scene.

    None where nothing is left of the scene.
    """
    if way is not None:
        corners = np.array([(-AROUND, -AROUND), (AROUND, AROUND)])
        return np.concatenate([way[:, :2].min(axis=0) + corners, way[:, :2].max(axis=0) + corners])
    rows = np.flatnonzero((document.state.flags & (Flag.DELETED | Flag.HIDDEN)) == 0)
    rows = rows[document.scene.nodes[rows] == 0]
    means = document.compute_means(rows[:: 1 + len(rows) // MOST_PLACES])
    means = means[np.isfinite(means).all(axis=1)]
    paths = [thing.path for thing in things if len(thing.path)]
    if len(means):
        paths.append(np.quantile(means[:, :2].astype(np.float64), SPREAD, axis=0))
    return np.concatenate(paths) if paths else None


def build_view_cone(
    viewpoint: Viewpoint, size: tuple[int, int], length: float
) -> tuple[Float64[ndarray, "2"], Float64[ndarray, "k 2"]]:
    """Build where the user looks from, and the far corners, `length` metres away, of what is seen along the ground.

    There are no corners where the view goes straight down. `size` is that of the picture in pixels.
    """
    camera = viewpoint.fit_camera(*size)
    forward = viewpoint.forward
    level = float(np.hypot(forward[0], forward[1]))
    if level < 0.1:
        return viewpoint.position[:2], np.zeros((0, 2))
    yaw, half = math.atan2(forward[1], forward[0]), math.atan(camera.width / 2 / camera.fx)
    angles = yaw + np.array([half, -half])
    return viewpoint.position[:2], viewpoint.position[:2] + length * np.stack([np.cos(angles), np.sin(angles)], axis=1)
