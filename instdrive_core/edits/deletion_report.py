"""What a deletion leaves: residue of the deleted things, and holes in the ground that no photo ever showed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Int64
from numpy import ndarray

from instdrive_core.edits.bases.parameters import check_ids
from instdrive_core.edits.bases.relabel import MAX_NAME_LENGTH, get_instance
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.holes.holes import Hole, find_hole
from instdrive_core.edits.holes.photo_evidence import PhotoEvidence, PhotoRecord, gather_photo_evidence
from instdrive_core.edits.holes.surroundings import Surroundings, find_surroundings
from instdrive_core.edits.kinds.absorb import find_floaters_around, find_rows_close_to
from instdrive_core.edits.kinds.compound import CompoundEdit
from instdrive_core.edits.kinds.delete import DeleteSelected
from instdrive_core.edits.kinds.fill_hole import FillHole, make_fill_hole
from instdrive_core.edits.kinds.select_rows import SelectRows
from instdrive_core.edits.queries.partial_deletion import Remainder, divide_instance, is_near_deleted
from instdrive_core.progress import report
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.transforms import copy_at_home, find_away
from instdrive_core.wording import format_count, phrase

MAX_GAP_SHARE = 0.02
"""Share of what a thing hid that may be open to the sky without a fill."""
SCRAP_SHARE = 0.1
"""An instance with at most this share of a deleted one's splats is no thing that stands behind it."""
PUT_ELSEWHERE = 1.0
"""Metres from its home from which a thing stands where photos never saw it."""


@dataclass(frozen=True)
class DeletedPart:
    """Rows of one instance that were deleted together."""

    instance_id: int
    name: str
    rows: Int64[ndarray, " m"]
    whole: bool
    """Nothing of the instance is left."""


@dataclass(frozen=True)
class DeletionReport:
    """The residue of a deletion, and the hole that it uncovers."""

    parts: tuple[DeletedPart, ...]
    residue: Int64[ndarray, " r"]
    """Rows, rising: strays in and close around what was deleted."""
    carriers: dict[int, int]
    """How many of them each instance has now; 0 = none."""
    hole: Hole | None
    """None where nothing that stood on the ground was deleted, or no ground was seen."""
    record: PhotoRecord | None = field(default=None, repr=False, compare=False)
    """What the photos showed of what was deleted, so that the fill need not look again; None where none did."""

    @property
    def name(self) -> str:
        """``Car 17`` or ``3 instances``, of which not all may be whole: ``parts of 3 instances``."""
        whole = all(part.whole for part in self.parts)
        if len(self.parts) == 1:
            return self.parts[0].name if whole else phrase("a part of {name}", name=self.parts[0].name)
        return (
            format_count(len(self.parts), "instance")
            if whole
            else phrase("parts of {count} instances", count=len(self.parts))
        )

    @property
    def hole_area(self) -> float:
        """Square metres."""
        return 0.0 if self.hole is None else self.hole.area

    @property
    def fill_area(self) -> float:
        """Square metres that filling the hole replaces: the hole and the shadow of what was deleted."""
        return 0.0 if self.hole is None or not self.hole_area else self.hole.area + self.hole.shadow_area

    @property
    def summary(self) -> str:
        """``34 splats of residue, hole of 3.1 m²``, and how much of that was in the shadow."""
        residue = (
            phrase("{splats} of residue", splats=format_count(len(self.residue), "splat"))
            if len(self.residue)
            else phrase("no residue")
        )
        hole = phrase("hole of {area:.1f} m²", area=self.fill_area) if self.hole_area else phrase("no hole")
        if self.hole is not None and self.hole.shadow_area and self.hole_area:
            area, dark = self.fill_area, self.hole.shadow_area
            hole = phrase("hole of {area:.1f} m², {dark:.1f} m² of it in the shadow", area=area, dark=dark)
        return phrase("{residue}, {hole}", residue=residue, hole=hole)

    def make_absorb_edit(self) -> Edit | None:
        """The edit that removes the residue; None where there is none."""
        if not len(self.residue):
            return None
        # Photos say which strays are residue: not all that `AbsorbFloaters` would take.
        return CompoundEdit(
            (SelectRows(self.residue), DeleteSelected()), phrase("Absorb floaters of {name}", name=self.name)
        )

    def make_fill_edit(self, seed: int = 0) -> FillHole | None:
        """The edit that fills the hole; None where there is none."""
        if self.hole is None or not (self.hole_area or self.hole.behind):
            return None
        edit = make_fill_hole(self.hole, phrase("fill of {name}", name=self.name)[:MAX_NAME_LENGTH], seed)
        edit.remember(self.record)
        return edit


def report_deletion(document: Document, ids: Iterable[int], time: float) -> DeletionReport:
    """Report what deleting instances left, or would leave; `time` (seconds) says where moving ones are.

    Raises EditError for an unknown ID.
    """
    parts = []
    for instance_id in check_ids(ids):
        name = get_instance(document, instance_id).name
        parts.append(DeletedPart(instance_id, name, document.find_rows((instance_id,)), True))
    return _build_report(document, parts, time)


def report_row_deletion(document: Document, rows: Int64[ndarray, " m"], time: float) -> DeletionReport:
    """Report what deleting some rows of any instances, such as a selection, left or would leave.

    `time` (seconds) says where moving instances are.
    """
    ids, parts = document.scene.instance_ids[rows], []
    for instance_id in np.unique(ids[ids > 0]).tolist():
        mine, name = rows[ids == instance_id], document.scene.table[instance_id].name
        whole = document.find_rows((instance_id,))
        left = (document.state.flags[whole] & Flag.DELETED) == 0
        if np.isin(whole[left], mine).all():  # the last part of what was deleted bit by bit
            parts.append(DeletedPart(instance_id, name, whole, True))
        else:
            parts.append(DeletedPart(instance_id, name, mine, False))
    return _build_report(document, parts, time)


def _build_report(document: Document, parts: Sequence[DeletedPart], time: float) -> DeletionReport:
    whole, parts = parts, [part for part in parts if _stands_where_it_was(document, part.rows)]
    remainders = [None if part.whole else divide_instance(document, part.instance_id, part.rows) for part in parts]
    kept = [remainder.kept for remainder in remainders if remainder is not None]
    evidence = gather_photo_evidence(document, [part.rows for part in parts], kept)
    found = []
    for number, (part, remainder) in enumerate(zip(parts, remainders, strict=True)):
        report(0.3 + 0.2 * number / len(parts))
        found.append(_find_residue(document, part, remainder, evidence))
    report(0.5)
    residue = np.unique(np.concatenate([np.zeros(0, np.int64), *found]))
    gone = np.concatenate([np.zeros(0, np.int64), *(part.rows for part in parts)])
    residue = np.setdiff1d(residue, gone, assume_unique=True)
    carried, counts = np.unique(document.scene.instance_ids[residue], return_counts=True)
    carriers = dict(zip(carried.tolist(), counts.tolist(), strict=True))
    around = find_surroundings(document, [(part.instance_id, part.rows) for part in parts], time, kept)
    report(0.7)
    hole = None if around is None else _find_hole(around, residue, evidence, tuple(part.instance_id for part in parts))
    record = None if evidence is None else evidence.record
    return DeletionReport(tuple(whole), residue, carriers, hole, record)


def _stands_where_it_was(document: Document, rows: Int64[ndarray, " m"]) -> bool:
    """Whether a thing hides what photos hid behind it; one that was put elsewhere leaves nothing where it stands."""
    away = rows[find_away(document.transforms, rows)]
    if 2 * len(away) <= len(rows):
        return True
    home = copy_at_home(document.scene.gaussians, document.transforms, away).means
    far = np.linalg.norm(document.compute_means(away) - home, axis=1) > PUT_ELSEWHERE
    return bool(2 * np.count_nonzero(far) <= len(rows))


def _find_hole(
    around: Surroundings, residue: Int64[ndarray, " r"], evidence: PhotoEvidence | None, ids: tuple[int, ...]
) -> Hole | None:
    if evidence is None:
        return find_hole(around, residue)
    behind = ids if evidence.gap_share > MAX_GAP_SHARE else ()
    return find_hole(around, np.union1d(residue, evidence.lost), evidence.looks, behind)


def _find_residue(
    document: Document, part: DeletedPart, remainder: Remainder | None, evidence: PhotoEvidence | None
) -> Int64[ndarray, " k"]:
    """Strays of what was deleted; of an instance that is not gone as a whole, not those of the `remainder`.

    Photos have the last word: what they show past the thing stays, what they show only in its silhouette goes.
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
        return strays
    strays = np.setdiff1d(strays, remainder.kept, assume_unique=True)
    return strays[np.isin(strays, remainder.missed) | is_near_deleted(document, strays, remainder)]
