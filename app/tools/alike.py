"""The tools that select what is like a clicked splat: by colour everywhere, or as far as it hangs together."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Int64
from numpy import ndarray

from instdrive_app.pointer import Click
from instdrive_app.render.picking import Picker
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.state import FrameSnapshot
from instdrive_app.tools.pick import PickTool
from instdrive_app.tools.surface import WinnerReader
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.frozen_copy import freeze_document
from instdrive_core.edits.kinds.select_rows import SelectRows
from instdrive_core.wording import format_count, phrase

Search = Callable[[Document, int, float, float], Int64[ndarray, " m"]]
"""Finds rows from a document, a row, a tolerance of colour and a time."""


class AlikeTool(PickTool):
    """Selects single splats that are like the clicked one; Shift adds, Ctrl removes. Drags move the camera."""

    options: tuple[str, ...] = ("alike.stricter", "alike.looser")

    def __init__(self, session: EditorSession, winners: WinnerReader, picker: Picker, search: Search) -> None:
        super().__init__(session, picker)
        self._winners, self._search = winners, search

    def click(self, click: Click, snapshot: FrameSnapshot) -> int:
        """Search from the clicked splat, in the background; returns its instance, 0 for none."""
        session, document = self._session, self._session.document
        if document is None:
            return 0
        winners = self._winners(replace(snapshot, draft=False))
        height, width = winners.shape
        row = int(winners[int(np.clip(click.y, 0, height - 1)), int(np.clip(click.x, 0, width - 1))]) - 1
        if row < 0:
            session.messages.info("There is no splat here; click something solid")
            return 0
        frozen, mode, tolerance = freeze_document(document), click.mode, session.state.color_tolerance

        def finish(rows: Int64[ndarray, " m"]) -> None:
            if session.document is document and session.history.apply(lambda: SelectRows(rows, mode)):
                session.messages.info(
                    phrase(
                        "{splats} within {tolerance:.0%} of its colour",
                        splats=format_count(len(rows), "splat"),
                        tolerance=tolerance,
                    )
                )

        session.jobs.submit(
            "Looking for splats alike",
            lambda: self._search(frozen, row, tolerance, snapshot.time),
            finish,
            modal=False,
        )
        return int(document.scene.instance_ids[row])
