"""Growing and shrinking the selection; the border of a large one is searched in the background."""

from __future__ import annotations

from instdrive_app.jobs import Job
from instdrive_app.session.context import SessionContext
from instdrive_core.edits.document.frozen_copy import freeze_document
from instdrive_core.edits.kinds.grow import BorderEdit, GrowSelection, ShrinkSelection
from instdrive_core.scene.selection import Flag
from instdrive_core.wording import phrase

AT_ONCE = 20_000
"""Selected splats up to which the search takes no longer than a frame."""
_TITLES: dict[type[BorderEdit], str] = {
    GrowSelection: "Growing the selection",
    ShrinkSelection: "Shrinking the selection",
}


class SelectionBorder:
    """Changes the selection along its border; changes requested during a search follow it in order."""

    def __init__(self, context: SessionContext) -> None:
        self._context, self._jobs, self._messages = context, context.jobs, context.messages
        self._job: Job | None = None
        self._following: list[type[BorderEdit]] = []

    def grow(self) -> None:
        """Add the splats near the selected ones."""
        self._ask(GrowSelection)

    def shrink(self) -> None:
        """Remove the splats near those that are not selected."""
        self._ask(ShrinkSelection)

    def _ask(self, kind: type[BorderEdit]) -> None:
        if self._job is not None and not self._job.over:
            self._following.append(kind)
        else:
            self._following.clear()  # these followed a search that was cancelled
            self._start(kind)

    def _start(self, kind: type[BorderEdit]) -> None:
        document = self._context.document
        if document is None:
            return
        edit = kind(None, self._context.state.time)
        if len(document.state.find_rows(Flag.SELECTED)) <= AT_ONCE:
            self._finish(edit)
            return
        frozen = freeze_document(document)

        def finish(_: None) -> None:
            if self._context.document is document and edit.is_prepared_for(document):
                self._finish(edit)
            else:
                self._following.clear()
                self._messages.info(
                    phrase(
                        "{title} was cancelled because the scene changed in the meantime", title=phrase(_TITLES[kind])
                    )
                )

        self._job = self._jobs.submit(_TITLES[kind], lambda: edit.prepare(frozen), finish, modal=False)

    def _finish(self, edit: BorderEdit) -> None:
        if self._context.apply(edit) and self._following:
            self._start(self._following.pop(0))
