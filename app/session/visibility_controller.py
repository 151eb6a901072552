"""Hiding, showing and locking instances."""

from __future__ import annotations

from collections.abc import Callable

from instdrive_app.session.context import SessionContext
from instdrive_app.session.solo_controller import SoloController
from instdrive_core.edits.kinds.visibility import HideInstances, LockInstances, ShowAll

Ids = tuple[int, ...]


class VisibilityController:
    """Decides what is drawn and what can be edited."""

    def __init__(self, context: SessionContext, bring_into_view: Callable[[Ids], None]) -> None:
        """`bring_into_view` gets what is shown alone: where it is out of view nothing at all would be seen."""
        self._context = context
        self.solo = SoloController(context, bring_into_view)

    @property
    def locked_ids(self) -> Ids:
        """IDs of the instances with any locked splat."""
        document = self._context.document
        if document is None:
            return ()
        counts = document.count_states()
        return tuple(counts.ids[counts.locked > 0].tolist())

    def hide(self, ids: Ids, hidden: bool = True) -> None:
        """Hide instances or show them again."""
        if ids:
            self._context.apply(lambda: HideInstances(ids, hidden))

    def show_all(self) -> None:
        """Show everything that is hidden."""
        self._context.apply(ShowAll)

    def lock(self, ids: Ids, locked: bool = True) -> None:
        """Protect instances from being selected and edited, or release them."""
        if ids:
            self._context.apply(lambda: LockInstances(ids, locked))
