"""Growing and shrinking the selection: of a large one the border is looked along beside the window."""

from __future__ import annotations

from instdrive_app.jobs import Job
from instdrive_app.session.context import SessionContext
from instdrive_core.edits.document.frozen_copy import freeze_document
from instdrive_core.edits.kinds.grow import BorderEdit, GrowSelection, ShrinkSelection
from instdrive_core.scene.selection import Flag

AT_ONCE = 20_000
"""Selected splats up to which it takes no longer than a frame."""
_TITLES: dict[type[BorderEdit], str] = {
    GrowSelection: "Growing the selection",
    ShrinkSelection: "Shrinking the selection",
}


class SelectionBorder:
    """Changes of the selection along its border; those asked for while one is under way follow it, in order."""

    def __init__(self, context: SessionContext) -> None:
        self._context, self._jobs, self._messages = context, context.jobs, context.messages
        self._job: Job | None = None
        self._following: list[type[BorderEdit]] = []

    def grow(self) -> None:
        """Select, too, what lies near the selected splats."""
        self._ask(GrowSelection)

    def shrink(self) -> None:
        """Deselect what lies near splats that are not selected."""
        self._ask(ShrinkSelection)

    def _ask(self, kind: type[BorderEdit]) -> None:
        if self._job is not None and not self._job.over:
            self._following.append(kind)
        else:
            self._following.clear()  # those after one that was cancelled
            self._start(kind)

    def _start(self, kind: type[BorderEdit]) -> None:
        document = self._context.document
        if document is None:
            return
        edit = kind(None, self._context.state.time)
        if len(document.state.rows_with(Flag.SELECTED)) <= AT_ONCE:
            self._finish(edit)
            return
        frozen = freeze_document(document)

        def finish(_: None) -> None:
            if self._context.document is document and edit.is_prepared_for(document):
                self._finish(edit)
            else:
                self._following.clear()
                self._messages.info(f"{_TITLES[kind]} was given up: something else was done meanwhile")

        self._job = self._jobs.submit(_TITLES[kind], lambda: edit.prepare(frozen), finish, modal=False)

    def _finish(self, edit: BorderEdit) -> None:
        if self._context.apply(edit) and self._following:
            self._start(self._following.pop(0))
