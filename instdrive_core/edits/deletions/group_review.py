"""What things that stood close together left when they were deleted: residue, and holes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray

from instdrive_core.edits.deletions.loose_pieces import find_loose_pieces
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.holes.bare_ground import find_bare_hole, find_bare_places, look_up_to_walls
from instdrive_core.edits.holes.behind.wide_things import find_hole_behind
from instdrive_core.edits.holes.deleted_neighbors import Members, find_deleted_neighbors
from instdrive_core.edits.holes.holes import Hole, build_ground_grid, find_hole
from instdrive_core.edits.holes.photo_evidence import PhotoEvidence, PhotoRecord, gather_photo_evidence
from instdrive_core.edits.holes.standing_height import HIGHEST, hides_too_much, measure_standing_height
from instdrive_core.edits.holes.surroundings import StandingObject, Surroundings, find_surroundings
from instdrive_core.edits.kinds.absorb import find_floaters_around, find_rows_close_to
from instdrive_core.edits.queries.compact_objects import is_compact
from instdrive_core.edits.queries.partial_deletion import Remainder, divide_instance, is_near_deleted
from instdrive_core.progress import report
from instdrive_core.wording import phrase

MAX_GAP_SHARE = 0.02
"""Share of what a thing hid that may be open to the sky without a fill."""
SCRAP_SHARE = 0.1
"""An instance with at most this share of a deleted one's splats is no thing that stands behind it."""
SIDE_SHARE = 0.5
"""Share of a single object's splats from which they are more than its far side: it is noise as a whole."""


@dataclass(frozen=True)
class DeletedPart:
    """Rows of one instance that were deleted together."""

    instance_id: int
    name: str
    rows: Int64[ndarray, " m"]
    whole: bool
    """Nothing of the instance is left."""


@dataclass(frozen=True)
class GroupReview:
    """What one group of deleted things left."""

    residue: Int64[ndarray, " r"]
    """Rows, rising."""
    holes: tuple[Hole, ...]
    record: PhotoRecord | None
    """What the photos showed of the group; None where none did."""
    unfilled: str = ""
    """Why nothing fills what the group hid, though photos never showed all of it; else empty."""


def review_group(
    document: Document, parts: Sequence[DeletedPart], all_parts: Sequence[DeletedPart], time: float
) -> GroupReview:
    """Find residue and holes of things that stood close together, beside `all_parts` that were deleted with them."""
    remainders = [None if part.whole else divide_instance(document, part.instance_id, part.rows) for part in parts]
    kept = [remainder.kept for remainder in remainders if remainder is not None]
    others = [part for part in all_parts if not any(part is mine for mine in parts)]
    leaving = join_rows(others)
    evidence = gather_photo_evidence(document, [part.rows for part in parts], kept, leaving=leaving)
    found = []
    for number, (part, remainder) in enumerate(zip(parts, remainders, strict=True)):
        report(0.6 + 0.2 * number / len(parts))
        found.append(_find_residue(document, part, remainder, evidence))
    residue = np.setdiff1d(np.unique(np.concatenate(found)), leaving, assume_unique=True)
    residue = np.setdiff1d(residue, join_rows(parts), assume_unique=True)
    report(0.8)
    members = [(part.instance_id, part.rows) for part in parts]

    def look_around(place: Float64[ndarray, "3"] | None) -> Surroundings | None:
        return find_surroundings(document, members, time, kept, leaving, place)

    around, record = look_around(None), None if evidence is None else evidence.record
    if around is None:
        if evidence is None:
            return GroupReview(residue, (), None)
        return _review_wide(document, members, evidence, time, leaving, residue)
    ids, gone = tuple(part.instance_id for part in parts), {part.instance_id: part.rows for part in others}

    def find_beside(place: Float64[ndarray, "3"]) -> tuple[StandingObject, ...]:
        return find_deleted_neighbors(document, place, ids, gone)

    large = any(hides_too_much(document, rows) for _, rows in members)
    behind = () if large else ids
    hole = _find_hole(around, residue, None if around.moves else evidence, behind, find_beside(around.place))
    if large:
        grounds = () if hole is None or not hole.area else (hole,)
        return GroupReview(_add_hidden(document, residue, evidence), grounds, record, _name_limit(evidence))
    walled = _is_walled(evidence)
    if hole is None and walled and evidence is not None and not around.moves:
        hole = find_hole_behind(document, members, evidence.looks, time, leaving)
    holes = [] if hole is None or not (hole.area or (hole.behind and walled)) else [hole]
    if around.moves and evidence is not None:
        holes += _find_bare_holes(around, evidence, holes, look_around, find_beside)
    lone = phrase("no ground found around it to fill from") if hole is None and walled else ""
    return GroupReview(residue if holes else _add_hidden(document, residue, evidence), tuple(holes), record, lone)


def _find_bare_holes(
    around: Surroundings,
    evidence: PhotoEvidence,
    earlier: Sequence[Hole],
    look_around: Callable[[Float64[ndarray, "3"]], Surroundings | None],
    find_beside: Callable[[Float64[ndarray, "3"]], tuple[StandingObject, ...]],
) -> list[Hole]:
    """Find the ground that something which moves hid all the time, but for what `earlier` holes have."""
    grid, holes = build_ground_grid(around), list[Hole]()
    if grid is None:
        return []
    looks = look_up_to_walls(evidence.looks, grid, around)
    for place in find_bare_places(looks, grid.plane, around.along):
        found = look_around(place)
        assert found is not None
        found = replace(found, plane=grid.plane)
        hole = find_bare_hole(found, looks, [*earlier, *holes], find_beside(place))
        if hole is not None:  # the first fill closes what stands behind
            holes.append(hole if holes else replace(hole, behind=tuple(each.body.instance for each in around.deleted)))
    return holes


def _review_wide(
    document: Document,
    members: Members,
    evidence: PhotoEvidence,
    time: float,
    leaving: Int64[ndarray, "_"],
    residue: Int64[ndarray, " r"],
) -> GroupReview:
    """Review what is no single object: a gap behind what stands low, or why nothing fills what it hid."""
    heights = [measure_standing_height(document, rows) for _, rows in members]
    if not any(heights):
        below = phrase("no photo shows what is below it") if _leaves_gap(evidence) else ""
        return GroupReview(residue, (), evidence.record, below)
    if _is_walled(evidence) and max(heights) <= HIGHEST:
        hole = find_hole_behind(document, members, evidence.looks, time, leaving)
        if hole is not None:
            return GroupReview(residue, (hole,), evidence.record)
    unfilled = _name_limit(evidence) if max(heights) > HIGHEST else ""
    return GroupReview(_add_hidden(document, residue, evidence), (), evidence.record, unfilled)


def join_rows(parts: Sequence[DeletedPart]) -> Int64[ndarray, " n"]:
    """Join the rows of all parts, rising."""
    return np.unique(np.concatenate([np.zeros(0, np.int64), *(part.rows for part in parts)]))


def _find_hole(
    around: Surroundings,
    residue: Int64[ndarray, " r"],
    evidence: PhotoEvidence | None,
    ids: tuple[int, ...],
    beside: Sequence[StandingObject],
) -> Hole | None:
    if evidence is None:
        return find_hole(around, residue, beside=beside)
    behind = ids if _leaves_gap(evidence) else ()
    return find_hole(around, np.union1d(residue, evidence.lost), evidence.looks, behind, beside)


def _add_hidden(
    document: Document, residue: Int64[ndarray, " r"], evidence: PhotoEvidence | None
) -> Int64[ndarray, " m"]:
    """The residue, with what the thing hid from all photos: a fill would replace it, but there is none.

    The far sides of single objects stay.
    """
    if evidence is None:
        return residue
    table, ids = document.scene.table, document.scene.instance_ids[evidence.hidden]
    numbers, counts = np.unique(ids, return_counts=True)
    sides = [
        number
        for number, count in zip(numbers.tolist(), counts.tolist(), strict=True)
        if number in table and is_compact(table[number]) and count < SIDE_SHARE * table[number].count
    ]
    return np.union1d(residue, evidence.hidden[~np.isin(ids, sides)])


def _name_limit(evidence: PhotoEvidence | None) -> str:
    """Why nothing fills what something high hid; empty where the photos show nearly all of it."""
    if not _leaves_gap(evidence):
        return ""
    return phrase("no photo shows what is behind it, and nothing higher than {most:g} m is filled behind", most=HIGHEST)


def _leaves_gap(evidence: PhotoEvidence | None) -> bool:
    return evidence is not None and evidence.gap_share > MAX_GAP_SHARE


def _is_walled(evidence: PhotoEvidence | None) -> bool:
    return evidence is not None and evidence.walled_share > MAX_GAP_SHARE


def _find_residue(
    document: Document, part: DeletedPart, remainder: Remainder | None, evidence: PhotoEvidence | None
) -> Int64[ndarray, " k"]:
    """Strays of what was deleted; of an instance that is not gone as a whole, not those of the `remainder`.

    Photos have the last word: what they show past the thing stays, what they show only in its silhouette goes. But
    small pieces that would hang in the air go, too.
    """
    kept = None if remainder is None else remainder.kept
    strays = find_floaters_around(document, part.instance_id, part.rows, kept)
    if evidence is not None:
        shown = find_rows_close_to(document, part.instance_id, part.rows, evidence.explained)
        ids = document.scene.instance_ids[strays]
        sizes = np.array([len(document.find_rows((number,))) for number in np.unique(ids).tolist()], np.int64)
        scraps = np.isin(ids, np.unique(ids)[sizes <= SCRAP_SHARE * len(part.rows)])
        strays = np.union1d(strays[scraps | ~np.isin(strays, evidence.seen)], shown)
    if remainder is None:
        stands = measure_standing_height(document, part.rows) > 0
        return np.union1d(strays, find_loose_pieces(document, part.rows)) if stands else strays
    strays = np.setdiff1d(strays, remainder.kept, assume_unique=True)
    return strays[np.isin(strays, remainder.missed) | is_near_deleted(document, strays, remainder)]
