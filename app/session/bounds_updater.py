"""Bounds of thousands of moved instances, computed some of them in each frame."""

from __future__ import annotations

from instdrive_app.session.context import SessionContext

ROWS_PER_FRAME = 150_000
"""Splats of moved instances that are looked at in one frame."""


class BoundsUpdater:
    """Runs what the document's moves have deferred, once nothing moves any more."""

    def __init__(self, context: SessionContext) -> None:
        self._context = context
        self._geometry: tuple[int, int] | None = None
        """The document's geometry version in the frame before."""

    def tick(self) -> None:
        """Do part of the deferred work; called once a frame."""
        document = self._context.document
        if document is None:
            return
        is_moving, self._geometry = document.versions.geometry != self._geometry, document.versions.geometry
        if document.deferred is not None:
            if not is_moving:
                document.run_deferred(ROWS_PER_FRAME)
            self._context.wake()
