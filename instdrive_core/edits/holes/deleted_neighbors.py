"""What was deleted together or close by: which things left one hole, and whose ground is no more known than its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64, Int64
from numpy import ndarray
from scipy.spatial.distance import cdist

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.synthetic_rows import SYNTHETIC
from instdrive_core.edits.holes.ground_cells import find_covered_cells
from instdrive_core.edits.holes.ground_grid import GroundGrid
from instdrive_core.edits.holes.holes import MAX_AWAY
from instdrive_core.edits.holes.standing_height import measure_standing_height
from instdrive_core.edits.holes.surroundings import REACH, StandingObject, find_lane_here, make_standing_object
from instdrive_core.edits.queries.compact_objects import is_compact
from instdrive_core.scene.selection import Flag

MAX_GAP = 2 * MAX_AWAY
"""Metres between two things, seen from above, for their holes to meet and to be one …"""
MAX_LENGTH, MAX_WIDTH = 12.0, 6.0
"""… and metres along and across the lane that the things of one hole span at most: half of what is looked at around
them, so that enough ground is known."""
FILLED_SHARE = 0.5
"""Share of the ground under a deleted thing that a fill must cover for it to be known again."""
_CORNERS = 200
"""Points of a thing, at most about so many, that tell where it stands."""
_CELL = 0.4
"""Metres per side of the cells in which splats of a fill are looked for."""

Members = Sequence[tuple[int, Int64[ndarray, "_"]]]
"""Things as their instance IDs and rows."""


@dataclass(frozen=True)
class _Footprint:
    thing: int
    places: Float64[ndarray, "k 2"]
    """World x and y, metres."""


def group_neighbors(document: Document, things: Members, time: float) -> list[list[int]]:
    """Group things that stood so close together that they left one hole; lists of places in `things`, rising.

    What moves is alone, where it is at `time` (seconds), and so is what is wide and stands upright, such as a fence or
    a house. What is no object, such as a piece of road, left no hole: it joins the only group, or makes one of its own.
    """
    found = [make_standing_object(document, number, rows) for number, rows in things]
    moving = [[place] for place, each in enumerate(found) if each is not None and each.track is not None]
    still = [
        _make_footprint(place, each) for place, each in enumerate(found) if each is not None and each.track is None
    ]
    groups = [sorted(each.thing for each in group) for group in _join_close(document, still, time)] + moving
    others = [place for place, each in enumerate(found) if each is None]
    upright = [place for place in others if measure_standing_height(document, things[place][1])]
    rest = [place for place in others if place not in upright]
    if rest and len(groups) == 1:
        groups, rest = [sorted(groups[0] + rest)], []
    return sorted(groups + [[place] for place in upright] + ([rest] if rest else []))


def _make_footprint(thing: int, standing: StandingObject) -> _Footprint:
    body = standing.body
    points = standing.points[body.holds((standing.points - body.center) @ body.axes, margin=1e-6)]
    return _Footprint(thing, points[:: 1 + len(points) // _CORNERS, :2])


def _join_close(document: Document, footprints: Sequence[_Footprint], time: float) -> list[list[_Footprint]]:
    """Join the closest pairs first, as long as the groups they make fit on a map of the ground."""
    groups = {number: [each] for number, each in enumerate(footprints)}
    owner = list(range(len(footprints)))
    for _, first, second in sorted(_measure_gaps(footprints)):
        one, other = owner[first], owner[second]
        if one == other:
            continue
        joined = groups[one] + groups[other]
        if _fits(document, np.concatenate([each.places for each in joined]), time):
            groups[one] = joined
            del groups[other]
            owner = [one if each == other else each for each in owner]
    return list(groups.values())


def _measure_gaps(footprints: Sequence[_Footprint]) -> list[tuple[float, int, int]]:
    """Metres between all pairs of things that are at most `MAX_GAP` apart."""
    lows = np.array([each.places.min(axis=0) for each in footprints])
    highs = np.array([each.places.max(axis=0) for each in footprints])
    gaps = []
    for second in range(len(footprints)):
        apart = np.maximum(lows[:second] - highs[second], lows[second] - highs[:second]).max(axis=1, initial=-np.inf)
        for first in np.flatnonzero(apart <= MAX_GAP).tolist():
            gap = float(cdist(footprints[first].places, footprints[second].places).min())
            if gap <= MAX_GAP:
                gaps.append((gap, first, second))
    return gaps


def _fits(document: Document, places: Float64[ndarray, "k 2"], time: float) -> bool:
    x, y = find_lane_here(document, np.append((places.min(axis=0) + places.max(axis=0)) / 2, 0.0), time)
    length, width = np.ptp(places @ np.array([[x, y], [-y, x]]).T, axis=0)
    return bool(length <= MAX_LENGTH and width <= MAX_WIDTH)


def find_deleted_neighbors(
    document: Document, place: Float64[ndarray, "3"], without: Sequence[int], leaving: Mapping[int, Int64[ndarray, "_"]]
) -> tuple[StandingObject, ...]:
    """Find things that stood around a place and are deleted, or `leaving`, and whose holes are not filled.

    Photos show the ground beside them only.

    Args:
        place: metres.
        without: IDs of instances that are left out.
        leaving: IDs and rows of what is about to be deleted, too.
    """
    gone = dict(leaving)
    for instance in document.scene.table:
        if is_compact(instance) and not instance.node and document.summarize_instance(instance.id).is_deleted:
            gone.setdefault(instance.id, document.find_rows((instance.id,)))
    near = []
    for number, rows in gone.items():
        if number not in without and len(rows):
            middle = np.median(document.compute_means(rows[:: 1 + len(rows) // _CORNERS]), axis=0)
            if np.abs(middle[:2] - place[:2]).max() <= REACH:
                near.append((number, rows))
    return pick_unfilled(document, near)


def pick_unfilled(document: Document, things: Members) -> tuple[StandingObject, ...]:
    """Keep the things that are objects, do not move, and have no filled ground below them."""
    found = [make_standing_object(document, number, rows) for number, rows in things]
    return _drop_filled(document, [each for each in found if each is not None and each.track is None])


def _drop_filled(document: Document, things: Sequence[StandingObject]) -> tuple[StandingObject, ...]:
    column = document.scene.extra.get(SYNTHETIC)
    if column is None or not things:
        return tuple(things)
    laid = np.flatnonzero((column == 1) & ((document.state.flags & Flag.DELETED) == 0))
    places = document.compute_means(laid)
    return tuple(each for each in things if not _is_filled(each, places))


def _is_filled(standing: StandingObject, laid: Float32[ndarray, "n 3"]) -> bool:
    """Whether enough of the ground under a thing has splats of a fill, whose places are `laid`."""
    x, y = (standing.body.center[:2] - standing.body.reach).tolist()
    side = max(1, round(2 * standing.body.reach / _CELL))
    grid = GroundGrid((x, y), (1.0, 0.0), _CELL, (side, side), (0.0, 0.0, 0.0))
    cells, under = grid.find_cells(laid), find_covered_cells((standing,), grid)
    filled = np.zeros(grid.shape, bool)
    filled[tuple(cells[grid.contains(cells)].T)] = True
    return bool(under.any() and filled[under].mean() >= FILLED_SHARE)
