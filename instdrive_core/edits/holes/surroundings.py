"""The neighbourhood of a deleted thing, copied out of the document."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int64, UInt32
from numpy import ndarray

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.compact_objects import (
    build_body,
    is_compact,
    is_tall,
    keep_main_node,
    select_solid_points,
)
from instdrive_core.edits.queries.placement import find_lane
from instdrive_core.errors import EditError
from instdrive_core.instances.interiors import CompactObject
from instdrive_core.maths.spherical_harmonics import color_from_dc
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.track import Track
from instdrive_core.scene.transforms import bake_transforms, compute_current_means, find_away

REACH = 14.0
"""Metres around the middle within which ground is looked at."""

MAX_POINTS = 3000
"""Points kept of one object: enough for its hull."""


@dataclass(frozen=True)
class StandingObject:
    """An object that stood, or stands, on the ground."""

    body: CompactObject
    points: Float64[ndarray, "k 3"]
    """Solid splats of it, at most about `MAX_POINTS`, metres, in the frame of its node."""
    track: Track | None
    """Track of its node; None = background."""


@dataclass(frozen=True)
class Neighborhood:
    """Background splats around a place, as they are now: none that are deleted, an actor's, or moved by hand."""

    rows: Int64[ndarray, " k"]
    """Row numbers in the document, rising."""
    means: Float32[ndarray, "k 3"]
    quats: Float32[ndarray, "k 4"]
    scales: Float32[ndarray, "k 3"]
    opacities: Float32[ndarray, " k"]
    colors: Float[ndarray, "k 3"]
    """RGB without view dependence."""
    instance_ids: UInt32[ndarray, " k"]
    locked: Bool[ndarray, " k"]
    compact: Bool[ndarray, " k"]
    """Part of an object that stands there."""
    tall: Bool[ndarray, " k"]
    """Part of one that is taller than any vehicle, such as a narrow house or a tree."""

    def exclude(self, rows: Int64[ndarray, " r"]) -> Neighborhood:
        """A neighbourhood without some rows of the document."""
        kept = ~np.isin(self.rows, rows)
        return Neighborhood(**{entry.name: getattr(self, entry.name)[kept] for entry in fields(self)})


@dataclass(frozen=True)
class Surroundings:
    """A deletion and its neighbourhood."""

    place: Float64[ndarray, "3"]
    """The middle of what was deleted, or of the ground behind it, metres in the world."""
    along: tuple[float, float]
    """Unit vector of the lane."""
    around: Neighborhood
    deleted: tuple[StandingObject, ...]
    others: tuple[StandingObject, ...]
    kept: tuple[Float64[ndarray, "k 3"], ...]
    """Solid splats that are left of each thing that was deleted in part and does not move, metres."""
    views: tuple[CameraView, ...]
    plane: tuple[float, float, float] | None = None
    """The ground's where too few splats tell: its height at the world's origin (metres), its slopes along x and y."""

    @property
    def moves(self) -> bool:
        """Whether all that was deleted moves."""
        return all(each.track is not None for each in self.deleted)


def find_surroundings(
    document: Document,
    groups: Sequence[tuple[int, Int64[ndarray, "_"]]],
    time: float,
    kept: Sequence[Int64[ndarray, "_"]] = (),
    leaving: Int64[ndarray, "_"] | None = None,
    place: Float64[ndarray, "3"] | None = None,
) -> Surroundings | None:
    """Surroundings of deleted rows, grouped by instance; None where no group is an object that stood on the ground.

    `time` (seconds) says where moving ones were, `kept` which rows of the same instances were left on purpose. Rows
    that are `leaving` count as deleted already. A `place` (metres) is looked at instead of that of what was deleted.
    """
    deleted = [found for found in (make_standing_object(document, *group) for group in groups) if found is not None]
    if not deleted:
        return None
    middle: Float64[ndarray, "3"] = np.mean([_find_middle(each, time) for each in deleted], axis=0)
    place = middle if place is None else place
    gone = [instance_id for instance_id, _ in groups]
    spared = [rows for _, rows in groups] + ([] if leaving is None else [leaving])
    near = find_neighborhood(document, place, np.concatenate(spared))
    others = find_standing_objects(document, near, gone)
    left = tuple(select_solid_points(document, rows[document.scene.nodes[rows] == 0]) for rows in kept)
    return Surroundings(
        place, find_lane_here(document, place, time), near, tuple(deleted), others, left, document.scene.views
    )


def find_lane_here(document: Document, place: Float64[ndarray, "3"], time: float) -> tuple[float, float]:
    """Find the unit vector of the lane at a place (metres) and a time (seconds); the y axis where no lane is known."""
    try:
        lane = find_lane(document, (), place, time)
    except EditError:
        return 0.0, 1.0
    return float(lane[0]), float(lane[1])


def find_standing_objects(
    document: Document, near: Neighborhood, without: Sequence[int] = ()
) -> tuple[StandingObject, ...]:
    """Objects of the neighbourhood that still stand, except some instances."""
    ids = [number for number in np.unique(near.instance_ids[near.compact]).tolist() if number not in without]
    found = [make_standing_object(document, number, _find_alive(document, number)) for number in ids]
    return tuple(each for each in found if each is not None)


def find_neighborhood(
    document: Document, place: Float64[ndarray, " m"], spared: Int64[ndarray, " n"] | None = None
) -> Neighborhood:
    """Splats within `REACH` of a place in the plane, except the rows `spared`, which may not be deleted yet."""
    scene, flags = document.scene, document.state.flags
    means = compute_current_means(scene.gaussians, document.transforms)
    offsets = np.abs(means[:, :2] - np.asarray(place[:2], np.float32))
    alive = (flags & Flag.DELETED) == 0
    rows = np.flatnonzero((offsets[:, 0] <= REACH) & (offsets[:, 1] <= REACH) & (scene.nodes == 0) & alive)
    rows = rows[~find_away(document.transforms, rows)]
    if spared is not None:
        rows = np.setdiff1d(rows, spared, assume_unique=True)
    return copy_neighborhood(document, rows)


def copy_neighborhood(document: Document, rows: Int64[ndarray, " k"]) -> Neighborhood:
    """Copy some rows of the document as they are now."""
    scene = document.scene
    ids = scene.instance_ids[rows]
    known = [scene.table[number] for number in np.unique(ids).tolist() if number in scene.table]
    standing = [instance for instance in known if is_compact(instance)]
    compact = np.isin(ids, [instance.id for instance in standing])
    tall = np.isin(ids, [instance.id for instance in standing if is_tall(instance)])
    part = scene.gaussians.select(rows)
    bake_transforms(part, document.transforms, document.transforms.indices[rows])
    colors, locked = color_from_dc(part.sh_dc), (document.state.flags[rows] & Flag.LOCKED) != 0
    return Neighborhood(rows, part.means, part.quats, part.scales, part.opacities, colors, ids, locked, compact, tall)


def make_standing_object(document: Document, instance_id: int, members: Int64[ndarray, " m"]) -> StandingObject | None:
    """The object that rows of an instance make up; None where they are too large, too flat or too few for one."""
    members = keep_main_node(document, members)
    body = build_body(document, instance_id, members)
    if body is None:
        return None
    node = int(document.scene.nodes[members[0]])
    track = document.scene.actors[node - 1] if node else None
    return StandingObject(body, select_solid_points(document, members[:: 1 + len(members) // MAX_POINTS]), track)


def _find_alive(document: Document, instance_id: int) -> Int64[ndarray, " m"]:
    rows = document.find_rows((instance_id,))
    return rows[(document.state.flags[rows] & Flag.DELETED) == 0]


def _find_middle(standing: StandingObject, time: float) -> Float64[ndarray, "3"]:
    return standing.body.center if standing.track is None else standing.track.interpolate_pose(time)[:3, 3]
