"""Moving, turning and scaling by handles: the tool picks, and says what the handles at the selection are for."""

from __future__ import annotations

from typing import Literal

from instdrive_app.session import EditorSession
from instdrive_app.tools.pick import PickTool

Operation = Literal["move", "rotate", "scale"]


class GizmoTool(PickTool):
    """Picks like the pick tool; while it is in hand, the selection has handles (`panels/overlays/gizmo.py`)."""

    def __init__(self, session: EditorSession, operation: Operation) -> None:
        super().__init__(session)
        self.operation: Operation = operation
