"""The tools as records: toolbar, commands and keys derive from them. A new tool is its file and a line in `TOOLS`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from instdrive_app.pointer import Tool
from instdrive_app.session import EditorSession
from instdrive_app.tools.gizmo import GizmoTool
from instdrive_app.tools.lasso import LassoTool
from instdrive_app.tools.pick import PickTool
from instdrive_app.tools.rectangle import RectangleTool
from instdrive_app.tools.region import Winners


@dataclass(frozen=True)
class ToolRecord:
    """One tool that the user can take."""

    name: str
    """What `EditorState.tool` is while it is in hand."""
    title: str
    icon: str
    """As for `Command`."""
    shortcut: str
    create: Callable[[EditorSession, Winners], Tool]
    starts_group: bool = False
    """Whether toolbar and menu part it from the tools before."""


TOOLS = (
    ToolRecord("pick", "Pick instances", "ICON_FA_ARROW_POINTER", "V", lambda session, _: PickTool(session)),
    ToolRecord("rectangle", "Select by rectangle", "ICON_FA_VECTOR_SQUARE", "B", RectangleTool),
    ToolRecord("lasso", "Select by lasso", "ICON_FA_SIGNATURE", "L", LassoTool),
    ToolRecord(
        "move",
        "Move",
        "ICON_FA_UP_DOWN_LEFT_RIGHT",
        "T",
        lambda session, _: GizmoTool(session, "move"),
        starts_group=True,
    ),
    ToolRecord("rotate", "Rotate", "ICON_FA_ARROWS_ROTATE", "R", lambda session, _: GizmoTool(session, "rotate")),
    ToolRecord("scale", "Scale", "ICON_FA_EXPAND", "Y", lambda session, _: GizmoTool(session, "scale")),
)
"""In the toolbar's order."""


def created_tools(session: EditorSession, winners: Winners) -> dict[str, Tool]:
    """One of each, by name."""
    return {record.name: record.create(session, winners) for record in TOOLS}
