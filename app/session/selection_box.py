"""The box around the selection, which moves with it and holds the gizmo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from jaxtyping import Float, Float64, Int64
from numpy import ndarray

from instdrive_app.session.versioned_cache import VersionedCache
from instdrive_core.edits.bases.deferred_bounds import DeferredBounds
from instdrive_core.edits.document.document import Document, InstanceCounts
from instdrive_core.edits.queries.placement import drop_strays, find_solid
from instdrive_core.instances.oriented_box import fit_upright_box
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.transforms import Similarity, extract_scale

COUNTED = 4000
"""Evenly chosen splats that the box of an instance is computed from."""


@dataclass(frozen=True)
class Box:
    """An oriented box in the world, metres."""

    center: Float64[ndarray, "3"]
    axes: Float64[ndarray, "3 3"]
    """Columns are unit vectors: to the right, forward (along the longer side), up."""
    size: Float64[ndarray, "3"]
    """Lengths along the axes."""

    @property
    def corners(self) -> Float64[ndarray, "8 3"]:
        """Corners in the order of bits: corner k lies high along axis i where bit 2 - i of k is set."""
        signs = np.array(list(product((-0.5, 0.5), repeat=3)))
        return self.center + signs * self.size @ self.axes.T

    @property
    def upright_axes(self) -> Float64[ndarray, "3 3"]:
        """Level axes with the same forward direction as seen from above."""
        return compute_upright_axes(self.axes[:, 1])

    def transform(self, matrix: Similarity) -> Box:
        """Apply the similarity [s R | t] to the box."""
        scale = extract_scale(matrix)
        center = matrix[:, :3] @ self.center + matrix[:, 3]
        return Box(center, matrix[:, :3] / scale @ self.axes, self.size * scale)

    def extent(self, direction: Float[ndarray, "3"]) -> float:
        """Extent of the box along a unit vector, metres."""
        return float(np.ptp(self.corners @ direction))


BOX_EDGES = tuple((corner, corner | bit) for corner in range(8) for bit in (1, 2, 4) if not corner & bit)
"""Pairs of corners that the edges join."""


def compute_upright_axes(forward: Float[ndarray, "3"]) -> Float64[ndarray, "3 3"]:
    """Compute the axes of a level `Box` that heads where `forward` points as seen from above."""
    length = float(np.hypot(forward[0], forward[1]))
    if length < 1e-6:
        return np.eye(3)
    x, y = forward[0] / length, forward[1] / length
    return np.array([[y, x, 0.0], [-x, y, 0.0], [0.0, 0.0, 1.0]])


class SelectionBoxes:
    """Finds boxes of selections.

    Keeps the trained box of the last instance, so that moving it costs nothing, and the box of the last group until
    something moves.
    """

    def __init__(self) -> None:
        self._instance = 0
        self._counts: InstanceCounts | None = None
        self._trained = Box(np.zeros(3), np.eye(3), np.zeros(3))
        self._home: Similarity = np.eye(3, 4)
        self._group: VersionedCache[Box] = VersionedCache()
        self._still: VersionedCache[Float64[ndarray, "e 3"]] = VersionedCache()

    def find_box(self, document: Document, ids: Sequence[int], time: float) -> Box:
        """Find the box of at least one instance at `time` (seconds).

        A moving actor has its track's box; a parked thing the smallest upright box of its splats as they were trained,
        moved as it was moved; several instances, or one of which parts were moved, have a box along the world's axes.
        """
        instance = document.scene.table[ids[0]]
        if len(ids) == 1 and instance.node:
            return _find_track_box(document, instance.node, time)
        entry = None if len(ids) > 1 else _find_common_entry(document, document.find_rows(ids))
        if entry is None:
            key = (tuple(ids), time, document.versions.geometry, document.versions.table)
            return self._group.get(document, key, lambda: self._find_level_box(document, ids, time))
        counts = document.count_states()  # made anew where splats change owner or state, but not where they move
        home = document.transforms.homes[entry]
        if counts is not self._counts or instance.id != self._instance or not np.array_equal(home, self._home):
            self._trained = _find_trained_box(document, instance.id, home)
            self._counts, self._instance, self._home = counts, instance.id, home.copy()
        return self._trained.transform(document.transforms.get_move(entry))

    def _find_level_box(self, document: Document, ids: Sequence[int], time: float) -> Box:
        """Find the box around the bounds of all instances, along the world's axes."""
        table = document.scene.table
        still = self._still.get(
            document, (tuple(ids), document.versions.table), lambda: _find_still_bounds(document, ids)
        )
        if isinstance(document.deferred, DeferredBounds) and len(still):
            still = document.deferred.move_box(still, ids)
        nodes = [node for node in (table[instance_id].node for instance_id in ids) if node]
        points = np.concatenate([still, *(_find_track_box(document, node, time).corners for node in nodes)])
        low, high = points.min(axis=0), points.max(axis=0)
        return Box((low + high) / 2, np.eye(3), high - low)


def _find_track_box(document: Document, node: int, time: float) -> Box:
    track = document.scene.actors[node - 1]
    pose = track.interpolate_pose(time)
    return Box(pose[:3, 3], pose[:3, :3], track.dimensions)


def _find_trained_box(document: Document, instance_id: int, home: Similarity) -> Box:
    """Find the upright box of an instance's remaining solid splats as trained, in a scene turned by `home`.

    Strays do not count: splats below the road made a parked pickup 7 m long.
    """
    rows = document.find_rows((instance_id,))
    left = rows[(document.state.flags[rows] & Flag.DELETED) == 0]
    rows = left if len(left) else rows
    rows = rows[np.linspace(0, len(rows) - 1, min(len(rows), COUNTED)).astype(int)]
    opacities = document.scene.gaussians.opacities[rows]
    rows = rows[find_solid(opacities)]
    means = document.scene.gaussians.means[rows].astype(np.float64) @ home[:, :3].T + home[:, 3]
    shape = drop_strays(means)
    found = fit_upright_box(shape, np.zeros((len(shape), 3, 3)))
    longer, across, up = found.rotation.T
    box = Box(found.center, np.stack([-across, longer, up], axis=1), found.size[[1, 0, 2]])
    return box if longer[1] >= 0 else replace(box, axes=box.axes * [-1, -1, 1])


def _find_still_bounds(document: Document, ids: Sequence[int]) -> Float64[ndarray, "e 3"]:
    """Find the lowest and highest corner of the instances that are no actors; no rows where all are."""
    instances = [document.scene.table[instance_id] for instance_id in ids]
    corners = np.array([instance.bounds for instance in instances if not instance.node], np.float64).reshape(-1, 3)
    return np.stack([corners.min(axis=0), corners.max(axis=0)]) if len(corners) else corners


def _find_common_entry(document: Document, rows: Int64[ndarray, " k"]) -> int | None:
    """Find the transform entry that all rows share; None where they were moved in different ways."""
    entries = document.transforms.indices[rows]
    return int(entries[0]) if (entries == entries[0]).all() else None
