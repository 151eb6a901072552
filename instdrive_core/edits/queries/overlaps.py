"""Things that reach into each other: what an edit has put somewhere may stand, or drive, where something else is."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.compact_objects import is_compact, keep_main_node
from instdrive_core.instances.interiors import DEFAULT_CONFIG
from instdrive_core.maths.activations import sigmoid
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.track import Track
from instdrive_core.wording import Phrase, phrase

LEAST_DEPTH = 0.2
"""Metres that a thing must reach into another: splats have a width, and wheels stand close to kerbs."""
MOST_AT_ONCE = 40
"""Things put somewhere at once that are looked at."""
_LEAST_POINTS, _LEAST_SHARE = 5, 0.01
"""Splats, and share of the thing's, that must lie so deep."""
_MOST_POINTS = 1500
_STRAYS = 0.02
"""Share of a thing's splats, on either side of each axis, that do not count for its box."""
_CLEARANCE = 0.15
"""Metres above a box's lower face that do not count: there lies the ground."""


@dataclass(frozen=True)
class Overlap:
    """One thing reaches into another."""

    first: int
    """Instance that was put somewhere."""
    second: int
    time: float
    """Seconds: when it reaches deepest."""
    depth: float
    """Metres along the ground."""
    passing: bool
    """At other moments it does not."""


@dataclass(frozen=True)
class _Shape:
    """Splats of one thing and its upright box, in the frame of its node."""

    instance: int
    node: int
    points: Float64[ndarray, "k 3"]
    center: Float64[ndarray, "3"]
    axes: Float64[ndarray, "3 3"]
    """Columns: the box's own axes, the third one up."""
    half: Float64[ndarray, "3"]

    @property
    def radius(self) -> float:
        """Metres from the middle of the box to a corner."""
        return float(np.linalg.norm(self.half))


class _Moments:
    """Where each node is at each of some times; found for all times at once, and only for nodes that are asked for."""

    def __init__(self, times: Sequence[float], tracks: Sequence[Track]) -> None:
        """The nodes are 0 for the background, then those of the tracks."""
        self.times, self._tracks = times, tracks
        self._poses: dict[int, Float64[ndarray, "t 4 4"]] = {}

    def find_poses(self, node: int) -> Float64[ndarray, "t 4 4"]:
        """Find world_from_node at each time."""
        if node not in self._poses:
            times = np.array(self.times, np.float64)
            still = np.tile(np.eye(4), (len(times), 1, 1))
            self._poses[node] = self._tracks[node - 1].interpolate_poses(times) if node else still
        return self._poses[node]

    def find_present(self, node: int) -> Bool[ndarray, " t"]:
        """Find at which times a node exists."""
        return np.array([node == 0 or self._tracks[node - 1].covers(time) for time in self.times])


def find_overlaps(
    document: Document, ids: Iterable[int], times: Sequence[float], added: Collection[int] = ()
) -> tuple[Overlap, ...]:
    """Find what the instances `ids` reach into at any of the `times` (seconds), the deepest first.

    Only compact things count: no ground, walls or hedges, and nothing that is deleted. Trained things that reached into
    each other before any edit do so for the instances' sake; only what has become deeper counts, but for those `added`.
    Nothing is found for more than `MOST_AT_ONCE` at once: they are a part of the scene, no single objects.
    """
    table = document.scene.table
    asked = [number for number in dict.fromkeys(ids) if number in table and is_compact(table[number])]
    if not 0 < len(asked) <= MOST_AT_ONCE:
        return ()
    near = _list_near(document, asked)
    shapes = {number: _make_shape(document, number) for number in (*asked, *near)}
    known = {number: shape for number, shape in shapes.items() if shape is not None}
    now = _Moments(times, document.scene.actors)
    found = []
    for place, number in enumerate(asked):
        for other in known if number in known else ():
            if other == number or other in asked[:place]:
                continue
            overlap = _compare(known[number], known[other], now)
            if overlap is not None and not (added and {number, other} & {*added}):
                before = _measure_before(document, number, other, times)
                overlap = overlap if overlap.depth >= before + LEAST_DEPTH else None
            found += [] if overlap is None else [overlap]
    return tuple(sorted(found, key=lambda each: -each.depth))


def list_drive_times(document: Document) -> list[float]:
    """List the moments of a drive, seconds, rising: those of its photos, else those of its tracks, else 0."""
    times = {view.time for view in document.scene.views}
    times = times or {time for track in document.scene.actors for time in track.times.tolist()}
    return sorted(times) or [0.0]


def describe_overlap(document: Document, overlap: Overlap) -> Phrase:
    """Say what reaches into what, how deep, and when."""
    table = document.scene.table
    names = {"first": table[overlap.first].name, "second": table[overlap.second].name}
    if overlap.passing:
        return phrase(
            "{first} reaches {depth:.1f} m into {second} at {time:.1f} s",
            **names, depth=overlap.depth, time=overlap.time,
        )  # fmt: skip
    return phrase("{first} reaches {depth:.1f} m into {second}", **names, depth=overlap.depth)


def _list_near(document: Document, asked: Sequence[int]) -> list[int]:
    """Other compact things that may come near those asked: all that move, and what stands still close by."""
    table = document.scene.table
    others = [each for each in table if is_compact(each) and each.id not in asked]
    if any(table[number].node for number in asked) or not others:
        return [each.id for each in others]
    bounds = np.array([each.bounds for each in others])
    close = np.array([each.node > 0 for each in others])
    for number in asked:
        low, high = np.array(table[number].bounds)
        close |= ((bounds[:, 0] <= high) & (bounds[:, 1] >= low)).all(axis=1)
    return [each.id for each, is_close in zip(others, close.tolist(), strict=True) if is_close]


def _measure_before(document: Document, first: int, second: int, times: Sequence[float]) -> float:
    """How deep two instances reached into each other as they were trained, metres; 0 where they did not."""
    shapes = [_make_shape(document, number, unmoved=True) for number in (first, second)]
    if shapes[0] is None or shapes[1] is None:
        return 0.0
    tracks = [document.get_first_track(node) for node in range(1, len(document.scene.actors) + 1)]
    overlap = _compare(shapes[0], shapes[1], _Moments(times, tracks))
    return 0.0 if overlap is None else overlap.depth


def _make_shape(document: Document, instance_id: int, unmoved: bool = False) -> _Shape | None:
    """The shape of what is left of an instance, where it is or, `unmoved`, where it was trained; None for what is too
    small or too low to be a thing."""
    rows = document.find_rows((instance_id,))
    rows = keep_main_node(document, rows[(document.state.flags[rows] & Flag.DELETED) == 0])
    rows = rows[:: 1 + len(rows) // _MOST_POINTS]
    rows = rows[sigmoid(document.scene.gaussians.opacity_logits[rows]) >= DEFAULT_CONFIG.min_opacity]
    if len(rows) < 2 * _LEAST_POINTS:
        return None
    points = (document.scene.gaussians.means[rows] if unmoved else document.compute_means(rows)).astype(np.float64)
    axes = np.eye(3)
    axes[:2, :2] = np.linalg.eigh(np.cov(points[:, :2].T))[1]
    low, high = np.quantile(points @ axes, [_STRAYS, 1 - _STRAYS], axis=0)
    if high[2] - low[2] < DEFAULT_CONFIG.min_height:
        return None
    node = int(document.scene.nodes[rows[0]])
    return _Shape(instance_id, node, points, axes @ ((low + high) / 2), axes, (high - low) / 2)


def _compare(first: _Shape, second: _Shape, moments: _Moments) -> Overlap | None:
    """Where one of two things reaches deepest into the other; None where it never does."""
    poses, others = moments.find_poses(first.node), moments.find_poses(second.node)
    apart = np.linalg.norm(_place(poses, first.center) - _place(others, second.center), axis=1)
    is_close = moments.find_present(first.node) & moments.find_present(second.node)
    together = np.flatnonzero(is_close & (apart <= first.radius + second.radius))
    if first.node == second.node:
        together = together[:1]
    depths = [
        max(_measure_depth(first, second, pose, other), _measure_depth(second, first, other, pose))
        for pose, other in zip(poses[together], others[together], strict=True)
    ]
    if not depths or max(depths) < LEAST_DEPTH:
        return None
    deepest = int(np.argmax(depths))
    passing = first.node != second.node and (min(depths) < LEAST_DEPTH or len(together) < len(moments.times))
    return Overlap(first.instance, second.instance, moments.times[together[deepest]], depths[deepest], passing)


def _place(poses: Float64[ndarray, "t 4 4"], point: Float64[ndarray, "3"]) -> Float64[ndarray, "t 3"]:
    return poses[:, :3, :3] @ point + poses[:, :3, 3]


def _measure_depth(
    box: _Shape, other: _Shape, box_pose: Float64[ndarray, "4 4"], other_pose: Float64[ndarray, "4 4"]
) -> float:
    """How deep enough splats of the other thing lie in a box, metres along the ground; 0 where they lie outside."""
    to_box = np.eye(4) if box.node == other.node else np.linalg.inv(box_pose) @ other_pose
    local = (other.points @ to_box[:3, :3].T + to_box[:3, 3] - box.center) @ box.axes
    inside = (local[:, 2] <= box.half[2]) & (local[:, 2] >= _CLEARANCE - box.half[2])
    depths = (box.half[:2] - np.abs(local[inside, :2])).min(axis=1)
    enough = max(_LEAST_POINTS, round(_LEAST_SHARE * len(other.points)))
    return max(float(np.sort(depths)[-enough]), 0.0) if len(depths) >= enough else 0.0
