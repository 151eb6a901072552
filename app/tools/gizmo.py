"""The tools that move, rotate and scale by handles: they pick, and say what the handles at the selection do."""

from __future__ import annotations

from instdrive_app.pointer import Operation
from instdrive_app.render.picking import Picker
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.tools.pick import PickTool

OPTIONS: dict[Operation, tuple[str, ...]] = {
    "move": ("move.on_ground", "move.along_lane", "move.lay_shadows"),
    "rotate": ("move.yaw_only", "move.body_only", "move.on_ground"),
    "scale": ("move.on_ground",),
}
"""IDs of the actions that constrain each operation."""


class GizmoTool(PickTool):
    """Picks like the pick tool; while it is current, the selection has handles (`panels/overlays/gizmo.py`)."""

    def __init__(self, session: EditorSession, operation: Operation, picker: Picker | None = None) -> None:
        super().__init__(session, picker)
        self.operation: Operation | None = operation
        self.options: tuple[str, ...] = OPTIONS[operation]
