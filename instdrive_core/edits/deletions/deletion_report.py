"""What a deletion leaves: residue of the deleted things, and holes in the ground that no photo ever showed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Int64
from numpy import ndarray

from instdrive_core.edits.bases.parameters import check_ids
from instdrive_core.edits.bases.relabel import MAX_NAME_LENGTH, get_instance
from instdrive_core.edits.deletions.group_review import DeletedPart, join_rows, review_group
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.holes.deleted_neighbors import group_neighbors
from instdrive_core.edits.holes.holes import Hole
from instdrive_core.edits.holes.photo_evidence import PhotoRecord
from instdrive_core.edits.kinds.compound import CompoundEdit
from instdrive_core.edits.kinds.delete import DeleteSelected
from instdrive_core.edits.kinds.fill_hole import FillHole, make_fill_hole
from instdrive_core.edits.kinds.select_rows import SelectRows
from instdrive_core.progress import report_span
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.transforms import copy_at_home, find_away
from instdrive_core.wording import format_count, phrase

MOST_RECORDS = 4
"""Groups of deleted things of which the report keeps what the photos showed: each takes tens of megabytes."""
PUT_ELSEWHERE = 1.0
"""Metres from its home from which a thing stands where photos never saw it."""


@dataclass(frozen=True)
class Clearing:
    """The hole that one or more things left which stood close together."""

    name: str
    """The name of what was deleted there: ``Car 17``."""
    hole: Hole
    record: PhotoRecord | None = field(default=None, repr=False, compare=False)
    """What the photos showed of what was deleted, so that the fill need not look again; None where none did."""


@dataclass(frozen=True)
class DeletionReport:
    """The residue of a deletion, and the holes that it uncovers."""

    parts: tuple[DeletedPart, ...]
    residue: Int64[ndarray, " r"]
    """Rows, rising: strays in and close around what was deleted."""
    carriers: dict[int, int]
    """How many of them each instance has now; 0 = none."""
    clearings: tuple[Clearing, ...]
    """None where nothing that stood on the ground was deleted, or no ground was seen."""
    unfilled: str = ""
    """Why nothing fills what some of it hid, though photos never showed it; else empty."""

    @property
    def name(self) -> str:
        """``Car 17`` or ``3 instances``, of which not all may be whole: ``parts of 3 instances``."""
        return _name_parts(self.parts)

    @property
    def holes(self) -> tuple[Hole, ...]:
        """Ground that no photo showed."""
        return tuple(each.hole for each in self.clearings if each.hole.area)

    @property
    def hole_area(self) -> float:
        """Square metres."""
        return sum(hole.area for hole in self.holes)

    @property
    def shadow_area(self) -> float:
        """Square metres of ground around the holes that lay in the shadow of what was deleted."""
        return sum(hole.shadow_area for hole in self.holes)

    @property
    def fill_area(self) -> float:
        """Square metres that filling the holes replaces: the holes and the shadows."""
        return self.hole_area + self.shadow_area

    @property
    def hole_text(self) -> str:
        """``hole of 3.1 m²`` or ``4 holes of 12.2 m²``, and how much of that was in the shadow; ``a gap behind it``."""
        count, area, dark = len(self.holes), self.fill_area, self.shadow_area
        if not count and self.clearings:
            return phrase("a gap behind it")
        if not count:
            return self.unfilled or phrase("no hole")
        if count > 1 and dark:
            return phrase(
                "{count} holes of {area:.1f} m², {dark:.1f} m² of it in the shadow", count=count, area=area, dark=dark
            )
        if count > 1:
            return phrase("{count} holes of {area:.1f} m²", count=count, area=area)
        if dark:
            return phrase("hole of {area:.1f} m², {dark:.1f} m² of it in the shadow", area=area, dark=dark)
        return phrase("hole of {area:.1f} m²", area=area)

    @property
    def summary(self) -> str:
        """``34 splats of residue, hole of 3.1 m²``, and how much of that was in the shadow."""
        residue = (
            phrase("{splats} of residue", splats=format_count(len(self.residue), "splat"))
            if len(self.residue)
            else phrase("no residue")
        )
        return phrase("{residue}, {hole}", residue=residue, hole=self.hole_text)

    def make_absorb_edit(self) -> Edit | None:
        """The edit that removes the residue; None where there is none."""
        if not len(self.residue):
            return None
        # Photos say which strays are residue: not all that `AbsorbFloaters` would take.
        return CompoundEdit(
            (SelectRows(self.residue), DeleteSelected()), phrase("Absorb floaters of {name}", name=self.name)
        )

    def make_fill_edits(self, seed: int = 0) -> tuple[FillHole, ...]:
        """The edits that fill the holes, to be done in this order."""
        edits = []
        for each in self.clearings:
            edit = make_fill_hole(each.hole, phrase("fill of {name}", name=each.name)[:MAX_NAME_LENGTH], seed)
            edit.remember(each.record)
            edits.append(edit)
        return tuple(edits)

    def forget_photos(self) -> DeletionReport:
        """The report without what the photos showed, which takes tens of megabytes a hole."""
        return replace(self, clearings=tuple(replace(each, record=None) for each in self.clearings))


def _name_parts(parts: Sequence[DeletedPart]) -> str:
    whole = all(part.whole for part in parts)
    if len(parts) == 1:
        return parts[0].name if whole else phrase("a part of {name}", name=parts[0].name)
    return format_count(len(parts), "instance") if whole else phrase("parts of {count} instances", count=len(parts))


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
    reviewed = [part for part in parts if _stands_where_it_was(document, part.rows)]
    groups = group_neighbors(document, [(part.instance_id, part.rows) for part in reviewed], time)
    residue, clearings, unfilled = [np.zeros(0, np.int64)], list[Clearing](), ""
    for number, places in enumerate(groups):
        with report_span(number / len(groups), (number + 1) / len(groups)):
            parts_here = [reviewed[place] for place in places]
            found = review_group(document, parts_here, reviewed, time)
        residue.append(found.residue)
        unfilled = unfilled or found.unfilled
        record = found.record if len(groups) <= MOST_RECORDS else None
        clearings += [Clearing(_name_parts(parts_here), hole, record) for hole in found.holes]
    left = np.setdiff1d(np.unique(np.concatenate(residue)), join_rows(reviewed), assume_unique=True)
    carried, counts = np.unique(document.scene.instance_ids[left], return_counts=True)
    carriers = dict(zip(carried.tolist(), counts.tolist(), strict=True))
    return DeletionReport(tuple(parts), left, carriers, tuple(clearings), unfilled)


def _stands_where_it_was(document: Document, rows: Int64[ndarray, " m"]) -> bool:
    """Whether a thing hides what photos hid behind it; one that was put elsewhere leaves nothing where it stands."""
    away = rows[find_away(document.transforms, rows)]
    if 2 * len(away) <= len(rows):
        return True
    home = copy_at_home(document.scene.gaussians, document.transforms, away).means
    far = np.linalg.norm(document.compute_means(away) - home, axis=1) > PUT_ELSEWHERE
    return bool(2 * np.count_nonzero(far) <= len(rows))
