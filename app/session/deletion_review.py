"""Review of deletions and moves: what they left is searched in the background, shown, and cleaned up on request."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64, Int64, UInt16
from numpy import ndarray

from instdrive_app.messages import read_error
from instdrive_app.session.context import SessionContext
from instdrive_core import progress
from instdrive_core.edits.bases.append import AppendEdit
from instdrive_core.edits.deletions.deletion_report import DeletionReport, report_deletion, report_row_deletion
from instdrive_core.edits.deletions.prepared_fill import PreparedFill, prepare_fills
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.document.frozen_copy import freeze_document
from instdrive_core.edits.holes.holes import Hole
from instdrive_core.edits.kinds.compound import CompoundEdit
from instdrive_core.edits.kinds.delete import DeleteInstances, DeleteRows, DeleteSelected
from instdrive_core.edits.kinds.fill_hole import FillHole
from instdrive_core.edits.kinds.light.lay_shadow import LayShadow
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.reset_moves import ResetMoves
from instdrive_core.errors import EditError
from instdrive_core.scene.selection import Flag
from instdrive_core.wording import format_count, phrase

SETTLE_SECONDS = 0.6
"""Time for which a move stays the last step before the place it left is reviewed."""
LEAST_MOVE = 0.5
"""Metres: what moves less, or only turns, still covers most of its old place."""
MOST_RESUMED = 8
"""Last deletions and moves of a recovered document that are reviewed again."""
MOST_VAIN_FILLS = 2
"""Fills that are computed beside edits, which make them void; the next one makes edits wait."""
MOST_INSTANCES = 100
"""Deletions of more instances are not reviewed: that would take minutes, and no single object was taken out."""


@dataclass
class DeletionFindings:
    """The report on a deletion, or on the place that a moved object has left, and what was done about it."""

    document: Document
    deletion: Edit
    report: DeletionReport
    residue: Float64[ndarray, "r 3"]
    """Positions of the residue in the frames of its nodes, metres."""
    nodes: UInt16[ndarray, " r"]
    absorption: Edit | None
    """The edit that deletes the residue, done or not; None without residue."""
    fill_edit: Edit | None = None
    """The edit that filled the holes, once it was done."""
    time: float = 0.0
    """Seconds into the drive at which it was looked at."""
    is_move: bool = False
    """Whether the object was moved instead of deleted."""

    @property
    def title(self) -> str:
        """``Deleted Car 17``."""
        name = self.report.name
        return phrase("Moved {name}", name=name) if self.is_move else phrase("Deleted {name}", name=name)

    @property
    def residue_count(self) -> int:
        """Number of residue splats that are still there."""
        return 0 if self._is_done(self.absorption) else len(self.report.residue)

    @property
    def holes(self) -> tuple[Hole, ...]:
        """The holes, in the ground or only in what stands behind, until they are filled."""
        return () if self._is_done(self.fill_edit) else tuple(each.hole for each in self.report.clearings)

    @property
    def is_current(self) -> bool:
        """Whether the deletion or move is done and leaves residue or holes."""
        return self._is_done(self.deletion) and (self.residue_count > 0 or bool(self.holes))

    def _is_done(self, edit: Edit | None) -> bool:
        return edit is not None and any(
            part is edit for each in self.document.history.done for part in _list_parts(each)
        )


@dataclass
class _Subject:
    """An edit to be reviewed."""

    edit: Edit
    time: float


class DeletionReview:
    """Reviews deletions and first moves, and keeps the reports until they are dealt with or dismissed.

    Undoing the clean-up brings a report back, undoing the deletion removes it.
    """

    def __init__(self, context: SessionContext) -> None:
        self._context, self._jobs, self._messages = context, context.jobs, context.messages
        self._findings: list[DeletionFindings] = []
        self._filling = self._fills_all = False
        self._last: tuple[Edit | None, float] = (None, 0.0)
        """The last edit of the history that was looked at as a move, and the seconds it has stayed the last."""
        self._known: list[Edit] = []
        """Moves that were looked at."""

    @property
    def pending(self) -> tuple[DeletionFindings, ...]:
        """What deletions and moves have left, oldest first."""
        document = self._context.document
        return tuple(found for found in self._findings if found.document is document and found.is_current)

    @property
    def findings(self) -> DeletionFindings | None:
        """The last of what is pending; None where nothing is left."""
        return next(reversed(self.pending), None)

    @property
    def is_filling(self) -> bool:
        """Whether a fill is being computed."""
        return self._filling

    def review_instances(self, ids: Iterable[int]) -> None:
        """Review the last step of the history, which deleted these whole instances."""
        ids, time = tuple(ids), self._context.state.time
        if len(ids) <= MOST_INSTANCES:
            self._look(lambda frozen: report_deletion(frozen, ids, time), time)

    def review_rows(self, rows: Int64[ndarray, " m"]) -> None:
        """Review the last step of the history, which deleted the splats of these rows."""
        document, time = self._context.document, self._context.state.time
        if document is not None and len(np.unique(document.scene.instance_ids[rows])) > MOST_INSTANCES:
            return
        self._look(lambda frozen: report_row_deletion(frozen, rows, time), time)

    def tick(self, seconds: float, is_dragging: bool) -> None:
        """Review a move once it has been the last step for a moment; called once a frame."""
        document = self._context.document
        last = _find_move(document.history.done[-1]) if document is not None and document.history.done else None
        if last is None or any(edit is last for edit in self._known):
            self._last = (None, 0.0)
            return
        waited = self._last[1] + seconds if self._last[0] is last else 0.0
        self._last = (last, waited)
        if waited >= SETTLE_SECONDS and not is_dragging:
            self._known.append(last)
            self._review_move(_Subject(last, self._context.state.time), is_told=True)

    def store(self) -> list[list[float]]:
        """Convert what is pending into JSON values: the number of each edit in the history, and the time."""
        document = self._context.document
        edits = document.history.edits if document is not None else ()
        numbers = {id(part): number for number, edit in enumerate(edits) for part in _list_parts(edit)}
        return [[numbers[id(found.deletion)], found.time] for found in self.pending if id(found.deletion) in numbers]

    def resume(self, stored: object) -> None:
        """Review again what was pending when a project was saved, as `store` gave it; else the last deletions."""
        document = self._context.document
        if document is None:
            return
        edits = document.history.done
        moves = [_find_move(edit) for edit in edits]
        self._findings, self._known = [], [move for move in moves if move is not None]
        subjects = _read_subjects(stored, document)
        if subjects is None:
            parts = [_find_move(edit) or edit for edit in edits]
            reviewed = [edit for edit in parts if isinstance(edit, (DeleteInstances, DeleteSelected, MoveInstances))]
            subjects = [_Subject(edit, self._context.state.time) for edit in reviewed[-MOST_RESUMED:]]
        for subject in subjects:
            if isinstance(subject.edit, MoveInstances):
                self._review_move(subject, is_told=False)
            else:
                self._review_again(subject)

    def _review_again(self, subject: _Subject) -> None:
        """Review a deletion of a reopened document."""
        edit, time = subject.edit, subject.time
        if isinstance(edit, DeleteInstances) and len(edit.ids) <= MOST_INSTANCES:
            ids = edit.ids
            self._look(lambda frozen: report_deletion(frozen, ids, time), time, edit, is_told=False)
        elif isinstance(edit, DeleteSelected):
            rows = edit.list_set_rows(Flag.DELETED)
            self._look(lambda frozen: report_row_deletion(frozen, rows, time), time, edit, is_told=False)

    def _review_move(self, subject: _Subject, is_told: bool) -> None:
        """Review the place where moved instances stood when the scene was trained, unless they were copies."""
        document, edit = self._context.document, subject.edit
        assert document is not None
        assert isinstance(edit, MoveInstances)
        added = {number for each in document.history.done for number in _list_added(each)}
        ids = tuple(number for number in edit.ids if number not in added)
        is_known = any(
            found.is_move and {part.instance_id for part in found.report.parts} & {*ids} for found in self.pending
        )
        if not ids or len(ids) > MOST_INSTANCES or is_known:
            return

        def look(frozen: Document) -> DeletionReport | None:
            rows = frozen.find_rows(ids)
            before = frozen.compute_means(rows)
            if not ResetMoves(ids).do(frozen) and not any(frozen.scene.table[number].node for number in ids):
                return None
            away = np.linalg.norm(frozen.compute_means(rows).mean(axis=0) - before.mean(axis=0))
            if away < LEAST_MOVE and not frozen.scene.nodes[rows].any():
                return None
            found = report_deletion(frozen, ids, subject.time)
            none = np.zeros(0, np.int64)
            return replace(found, residue=none, carriers={}) if found.hole_area else None

        self._look(look, subject.time, edit, is_told, is_move=True)

    def absorb(self) -> None:
        """Delete the residue as well."""
        found = self.findings
        if found is None or not found.residue_count or found.absorption is None:
            return
        if self._context.apply(found.absorption):
            self._messages.info(
                phrase("{splats} of residue deleted", splats=format_count(len(found.report.residue), "splat"))
            )

    def fill(self) -> None:
        """Fill the holes of the last step with ground like that around them, computed in the background."""
        if not self._filling:
            self._fills_all = False
            self._fill_last()

    def _fill_last(self) -> None:
        found = next((found for found in reversed(self.pending) if found.holes), None)
        self._fills_all &= found is not None
        if found is not None:  # later reports may only have residue
            self._fill(found, 0)

    def _fill(self, found: DeletionFindings, tries: int) -> None:
        """Fill the holes. Edits wait for that once it has been computed in vain for so many times."""
        edits, document = found.report.make_fill_edits(), found.document
        frozen = freeze_document(document)
        self._filling = True

        def finish(fill: PreparedFill) -> None:
            self._filling = False
            if self._context.document is not document:
                return
            if not fill.is_prepared_for(document):  # the document was edited in the meantime
                if any(each is found for each in self.pending) and found.holes:
                    self._fill(found, tries + 1)
            elif self._context.apply(fill.edit):
                found.fill_edit = fill.edit
                self._tell_filled(fill)
                if self._fills_all:
                    self._fill_last()

        def handle_failure(error: BaseException) -> bool:
            self._filling = self._fills_all = False
            if isinstance(error, EditError):
                self._messages.error(phrase("The hole cannot be filled: {error}", error=read_error(error)))
            return isinstance(error, EditError)

        modal = tries >= MOST_VAIN_FILLS
        self._jobs.submit(
            "Filling the hole" if len(found.holes) == 1 else "Filling the holes",
            lambda: prepare_fills(frozen, edits),
            finish,
            modal=modal,
            on_failure=handle_failure,
        )

    def _tell_filled(self, fill: PreparedFill) -> None:
        count, area = fill.hole_count, fill.area
        if count > 1:
            text = phrase("Filled {count} holes of {area:.1f} m² with synthetic ground", count=count, area=area)
        elif not count:
            text = phrase("Filled the gap with synthetic splats")
        else:
            text = phrase("Filled a hole of {area:.1f} m² with synthetic ground", area=area)
        self._messages.info(text)
        if fill.refused:
            self._messages.error(
                phrase(
                    "{count} of the holes cannot be filled: {error}",
                    count=len(fill.refused),
                    error=read_error(fill.refused[0]),
                )
            )

    def fill_all(self) -> None:
        """Fill all pending holes, one after the other."""
        if not self._filling:
            self._fills_all = True
            self._fill_last()

    def clear(self) -> None:
        """Dismiss the report that is shown; the one before it is shown then."""
        found = self.findings
        self._findings = [each for each in self._findings if each is not found]

    def clear_all(self) -> None:
        """Dismiss all reports."""
        self._findings.clear()

    def _look(
        self,
        work: Callable[[Document], DeletionReport | None],
        time: float,
        edit: Edit | None = None,
        is_told: bool = True,
        is_move: bool = False,
    ) -> None:
        """Review an edit, by default the last one, in the background."""
        document = self._context.document
        if document is None:
            return
        deletion, frozen = edit or document.history.done[-1], freeze_document(document, keeps_ids=True)

        def look() -> DeletionFindings | None:
            report = work(frozen)
            if report is None:
                return None
            progress.report(0.9)
            absorption = report.make_absorb_edit()
            places = frozen.compute_means(report.residue).astype(np.float64)
            nodes = frozen.scene.nodes[report.residue]
            return DeletionFindings(document, deletion, report, places, nodes, absorption, time=time, is_move=is_move)

        def finish(found: DeletionFindings | None) -> None:
            if found is None or self._context.document is not document:
                return
            is_left = found.is_current and not (edit is not None and _is_filled(document, found))
            if is_left:
                for older in self._findings:  # what the photos showed takes tens of megabytes
                    older.report = older.report.forget_photos()
                self._findings.append(found)
            if is_told and (is_left or found.report.unfilled):
                summary = (
                    phrase("{hole} where it stood", hole=found.report.hole_text) if is_move else found.report.summary
                )
                self._messages.info(phrase("{title}: {summary}", title=found.title, summary=summary))

        self._jobs.submit_in_background(phrase("Reviewing “{title}”", title=deletion.title), look, finish)


def _read_subjects(stored: object, document: Document) -> list[_Subject] | None:
    """Read what `DeletionReview.store` gave; None where it is nothing of the kind."""
    if not isinstance(stored, list):
        return None
    edits, subjects = document.history.edits, []
    for entry in stored:
        if (
            not isinstance(entry, list)
            or len(entry) != 2
            or not all(isinstance(value, (int, float)) for value in entry)
        ):
            return None
        number, time = int(entry[0]), float(entry[1])
        if 0 <= number < len(edits) and np.isfinite(time):
            subjects.append(_Subject(_find_move(edits[number]) or edits[number], time))
    return subjects


def _list_parts(edit: Edit) -> tuple[Edit, ...]:
    """An edit and, where it is a step with its shadow, what the step was made of."""
    return (edit, *edit.edits) if isinstance(edit, CompoundEdit) else (edit,)


def _find_move(edit: Edit) -> MoveInstances | None:
    """The move that an edit is, alone or with the shadow that was laid after it."""
    if isinstance(edit, CompoundEdit) and len(edit.edits) > 1 and all(_is_shadow(part) for part in edit.edits[1:]):
        edit = edit.edits[0]
    return edit if isinstance(edit, MoveInstances) else None


def _is_shadow(edit: Edit) -> bool:
    return isinstance(edit, (LayShadow, DeleteRows))


def _list_added(edit: Edit) -> tuple[int, ...]:
    """IDs of the instances that an edit has added."""
    if isinstance(edit, CompoundEdit):
        return tuple(number for part in edit.edits for number in _list_added(part))
    return edit.added_ids if isinstance(edit, AppendEdit) else ()


def _is_filled(document: Document, found: DeletionFindings) -> bool:
    """Whether later edits of a reopened document have filled the holes, and nothing else is left."""
    done = document.history.done
    after = done[next((number for number, edit in enumerate(done) if edit is found.deletion), 0) :]
    filled = {part.name for edit in after for part in _list_parts(edit) if isinstance(part, FillHole)}
    fills = found.report.make_fill_edits()
    return bool(fills) and {fill.name for fill in fills} <= filled and not found.residue_count
