"""The tool that measures between two clicked points."""

from __future__ import annotations

from instdrive_app.pointer import Click
from instdrive_app.render.picking import Picker
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.state import FrameSnapshot
from instdrive_app.tools.pick import PickTool
from instdrive_app.tools.surface import WinnerReader, find_surface
from instdrive_core.wording import phrase


class MeasureTool(PickTool):
    """Sets the two ends of the ruler by clicks; a third click begins anew. Drags move the camera."""

    options: tuple[str, ...] = ("measure.clear",)

    def __init__(self, session: EditorSession, winners: WinnerReader, picker: Picker | None = None) -> None:
        super().__init__(session, picker)
        self._winners = winners

    def click(self, click: Click, snapshot: FrameSnapshot) -> int:
        """Set a point on what is under the pointer; returns its instance, 0 for none."""
        document = self._session.document
        if document is None:
            return 0
        found = find_surface(document, self._winners, snapshot, click.x, click.y)
        if found is None:
            self._session.messages.info("There is nothing here to measure; click something solid")
            return 0
        ruler = self._session.aids.ruler
        ruler.add(found.place)
        if ruler.describe():
            self._session.messages.info(phrase("Measured {length}", length=ruler.describe()))
        return int(document.scene.instance_ids[found.row])
