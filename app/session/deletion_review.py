"""Review of the last deletion: what it left is searched in the background, shown, and cleaned up on request."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64, UInt16
from numpy import ndarray

from instdrive_app.session.context import SessionContext
from instdrive_core import progress
from instdrive_core.edits.deletion_report import DeletionReport, report_deletion, report_row_deletion
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.document.frozen_copy import freeze_document
from instdrive_core.edits.holes.holes import Hole
from instdrive_core.edits.kinds.absorb import AbsorbFloaters
from instdrive_core.errors import EditError

MOST_INSTANCES = 100
"""Deletions of more instances are not reviewed: that would take minutes, and no single object was taken out."""


@dataclass
class DeletionFindings:
    """The report on a deletion, and what was done about it."""

    document: Document
    deletion: Edit
    report: DeletionReport
    residue: Float64[ndarray, "r 3"]
    """Positions of the residue in the frames of its nodes, metres."""
    nodes: UInt16[ndarray, " r"]
    absorption: Edit | None
    """The edit that deletes the residue, done or not; None without residue."""
    fill_edit: Edit | None = None
    """The edit that filled the hole, once it was done."""

    @property
    def residue_count(self) -> int:
        """Number of residue splats that are still there."""
        return 0 if self._is_done(self.absorption) else len(self.report.residue)

    @property
    def hole(self) -> Hole | None:
        """The hole, until it is filled."""
        return None if self._is_done(self.fill_edit) or not self.report.hole_area else self.report.hole

    @property
    def is_current(self) -> bool:
        """Whether the deletion is done and leaves residue or a hole."""
        return self._is_done(self.deletion) and (self.residue_count > 0 or self.hole is not None)

    def _is_done(self, edit: Edit | None) -> bool:
        return edit is not None and any(each is edit for each in self.document.history.done)


class DeletionReview:
    """Reviews deletions. Undoing the clean-up brings the report back, undoing the deletion removes it."""

    def __init__(self, context: SessionContext) -> None:
        self._context, self._jobs, self._messages = context, context.jobs, context.messages
        self._finding: DeletionFindings | None = None
        self._filling = False

    @property
    def findings(self) -> DeletionFindings | None:
        """What to show; None where the last deletion left nothing."""
        found, document = self._finding, self._context.document
        return found if found is not None and found.document is document and found.is_current else None

    @property
    def is_filling(self) -> bool:
        """Whether a fill is being computed."""
        return self._filling

    def review_instances(self, ids: Iterable[int]) -> None:
        """Review the last step of the history, which deleted these whole instances."""
        ids, time = tuple(ids), self._context.state.time
        if len(ids) > MOST_INSTANCES:
            self._finding = None
            return
        self._look(lambda frozen: report_deletion(frozen, ids, time))

    def review_rows(self, rows: Int64[ndarray, " m"]) -> None:
        """Review the last step of the history, which deleted the splats of these rows."""
        time = self._context.state.time
        self._look(lambda frozen: report_row_deletion(frozen, rows, time))

    def absorb(self) -> None:
        """Delete the residue as well."""
        found = self.findings
        if found is None or not found.residue_count or found.absorption is None:
            return
        if self._context.apply(found.absorption):
            self._messages.info(f"{len(found.report.residue):,} splats of residue deleted")

    def fill(self) -> None:
        """Fill the hole with ground like that around it, computed in the background."""
        found, document = self.findings, self._context.document
        edit = found.report.make_fill_edit() if found is not None and found.hole is not None else None
        if self._filling or found is None or edit is None or document is None:
            return
        frozen = freeze_document(document)
        self._filling = True

        def finish(_: object) -> None:
            self._filling = False
            if self._context.document is document and self._context.apply(edit):
                found.fill_edit = edit
                self._messages.info(f"Filled a hole of {found.report.hole_area:.1f} m² with synthetic ground")

        def handle_failure(error: BaseException) -> bool:
            self._filling = False
            if isinstance(error, EditError):
                self._messages.error(f"The hole cannot be filled: {error}")
            return isinstance(error, EditError)

        self._jobs.submit(
            "Filling the hole", lambda: edit.prepare(frozen), finish, modal=False, on_failure=handle_failure
        )

    def clear(self) -> None:
        """Dismiss the report."""
        self._finding = None

    def _look(self, work: Callable[[Document], DeletionReport]) -> None:
        document = self._context.document
        if document is None:
            return
        deletion, frozen = document.history.done[-1], freeze_document(document)

        def look() -> DeletionFindings:
            report = work(frozen)
            progress.report(0.9)
            absorption = report.make_absorb_edit()
            if isinstance(absorption, AbsorbFloaters):
                absorption.prepare(frozen)
            places = frozen.compute_means(report.residue).astype(np.float64)
            return DeletionFindings(document, deletion, report, places, frozen.scene.nodes[report.residue], absorption)

        def finish(found: DeletionFindings) -> None:
            if self._context.document is document and found.is_current:
                self._finding = found
                self._messages.info(f"Deleted {found.report.name}: {found.report.summary}")

        self._jobs.submit_in_background("Reviewing the deletion", look, finish)
