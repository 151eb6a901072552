"""Deleting instances and splats, and reviewing what a deletion leaves."""

from __future__ import annotations

from instdrive_app.session.context import SessionContext
from instdrive_app.session.deletion_review import DeletionReview
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.delete import DeleteInstances, DeleteSelected
from instdrive_core.scene.selection import Flag


class DeletionController:
    """Deletes, then has the result reviewed."""

    def __init__(self, context: SessionContext) -> None:
        self._context = context
        self.review = DeletionReview(context)

    def delete(self, ids: tuple[int, ...]) -> None:
        """Delete instances."""
        if ids and self._context.apply(lambda: DeleteInstances(ids)):
            self.review.review_instances(ids)
            if self._context.state.hovered in ids:
                self._context.state.hovered = 0

    def delete_selection(self) -> None:
        """Delete the selected splats, and no others of their instances."""
        document = self._context.document
        if document is None:
            return
        if selects_whole_instances(document):
            self.delete(document.find_selected_instances())
            return
        rows = document.state.find_rows(Flag.SELECTED)
        if len(rows) and self._context.apply(DeleteSelected):
            self.review.review_rows(rows)
            self._context.state.hovered = 0


def selects_whole_instances(document: Document) -> bool:
    """Whether the selection consists of whole instances and nothing else; False where nothing is selected."""
    counts = document.count_states()
    chosen = counts.selected > 0
    whole = (counts.selected == counts.count - counts.deleted)[chosen].all()
    alone = counts.selected.sum() == len(document.state.find_rows(Flag.SELECTED))
    return bool(chosen.any() and whole and alone)
