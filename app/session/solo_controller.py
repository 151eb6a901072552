"""Showing some instances alone, and returning to what was shown before."""

from __future__ import annotations

from collections.abc import Callable

from instdrive_app.session.context import SessionContext
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.compound import CompoundEdit
from instdrive_core.edits.kinds.solo import SoloInstances
from instdrive_core.edits.kinds.visibility import HideInstances, ShowAll

Ids = tuple[int, ...]


class SoloController:
    """Shows instances alone, and remembers what was hidden before.

    Whether they are still alone is read from the document: undoing the step ends it, redoing brings it back.
    """

    def __init__(self, context: SessionContext, bring_into_view: Callable[[Ids], None]) -> None:
        self._context, self._bring_into_view = context, bring_into_view
        self._of: Document | None = None
        self._ids: Ids = ()
        self._step: SoloInstances | None = None
        self._hidden_before: Ids = ()
        self._known: tuple[int, int, bool] | None = None

    @property
    def ids(self) -> Ids:
        """IDs of the instances shown alone; empty where everything may be shown."""
        document = self._context.document
        if document is None or document is not self._of or not self._ids:
            return ()
        versions = (document.versions.states, document.versions.table)
        if self._known is None or self._known[:2] != versions:
            self._known = (*versions, self._is_in_force(document))
        return self._ids if self._known[2] else ()

    def _is_in_force(self, document: Document) -> bool:
        visible = document.find_visible_instances()
        if visible:
            return len(visible) <= len(self._ids) and set(visible) <= set(self._ids)
        # What was shown alone has been deleted or hidden since; the rest stays hidden unless the step was undone.
        return any(edit is self._step for edit in document.history.done)

    def enter(self, ids: Ids) -> None:
        """Show these instances and nothing else; what was hidden before the first of several solos is remembered."""
        document = self._context.document
        if document is None or not ids:
            return
        hidden = self._hidden_before if self.ids else find_hidden_instances(document)
        step = SoloInstances(ids)
        if self._context.apply(step):
            self._of, self._ids, self._hidden_before, self._known = document, tuple(ids), hidden, None
            self._step = step
            self._bring_into_view(ids)

    def leave(self) -> None:
        """Show everything again that was shown before."""
        document = self._context.document
        if document is None or not self.ids:
            return
        hidden = tuple(i for i in self._hidden_before if i in document.scene.table)
        if hidden:
            self._context.apply(CompoundEdit((ShowAll(), HideInstances(hidden)), "Show all that was shown before"))
        else:
            self._context.apply(ShowAll)

    def toggle(self, ids: Ids) -> None:
        """Show these instances alone, or leave where they already are alone."""
        if ids and set(ids) == set(self.ids):
            self.leave()
        else:
            self.enter(ids)


def find_hidden_instances(document: Document) -> Ids:
    """Find instances that are not deleted but not drawn either; IDs in rising order."""
    counts = document.count_states()
    return tuple(counts.ids[(counts.drawn == 0) & (counts.count > counts.deleted)].tolist())
