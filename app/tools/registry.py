"""The tools as records, from which toolbar, menu and shortcuts derive. A new tool is its file and a line in `TOOLS`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from instdrive_app.pointer import Operation, Tool
from instdrive_app.render.picking import Picker
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.tools.alike import AlikeTool
from instdrive_app.tools.box import BoxTool
from instdrive_app.tools.brush import BrushTool
from instdrive_app.tools.gizmo import GizmoTool
from instdrive_app.tools.lasso import LassoTool
from instdrive_app.tools.measure import MeasureTool
from instdrive_app.tools.path import PathTool
from instdrive_app.tools.pick import PickTool
from instdrive_app.tools.polygon import PolygonTool
from instdrive_app.tools.rectangle import RectangleTool
from instdrive_app.tools.sphere import SphereTool
from instdrive_app.tools.surface import WinnerReader
from instdrive_core.edits.queries.spreading import find_alike_rows, find_flooded_rows


@dataclass(frozen=True)
class ToolParts:
    """What all tools share."""

    session: EditorSession
    winners: WinnerReader
    picker: Picker


@dataclass(frozen=True)
class ToolRecord:
    """One tool that the user can choose."""

    name: str
    """Value of `EditorState.tool` while the tool is current."""
    title: str
    icon: str
    """Name of an icon constant of Font Awesome 6, e.g. ``ICON_FA_EXPAND``."""
    shortcut: str
    """Key that chooses the tool."""
    create: Callable[[ToolParts], Tool]
    starts_group: bool = False
    """Whether toolbar and menu separate it from the tools before."""
    words: tuple[str, ...] = ()
    """Other words by which the command palette finds it."""


def _make_handles_tool(operation: Operation) -> Callable[[ToolParts], Tool]:
    return lambda parts: GizmoTool(parts.session, operation, parts.picker)


TOOLS = (
    ToolRecord(
        "pick", "Pick instances", "ICON_FA_ARROW_POINTER", "V", lambda parts: PickTool(parts.session, parts.picker)
    ),
    ToolRecord(
        "rectangle",
        "Select by rectangle",
        "ICON_FA_VECTOR_SQUARE",
        "B",
        lambda parts: RectangleTool(parts.session, parts.winners, parts.picker),
    ),
    ToolRecord(
        "lasso",
        "Select by lasso",
        "ICON_FA_SIGNATURE",
        "L",
        lambda parts: LassoTool(parts.session, parts.winners, parts.picker),
    ),
    ToolRecord(
        "polygon",
        "Select by polygon",
        "ICON_FA_DRAW_POLYGON",
        "N",
        lambda parts: PolygonTool(parts.session, parts.winners, parts.picker),
    ),
    ToolRecord(
        "brush",
        "Select by brush",
        "ICON_FA_PAINTBRUSH",
        "X",
        lambda parts: BrushTool(parts.session, parts.winners, parts.picker),
    ),
    ToolRecord(
        "sphere",
        "Select by sphere",
        "ICON_FA_GLOBE",
        "J",
        lambda parts: SphereTool(parts.session, parts.winners, parts.picker),
    ),
    ToolRecord(
        "box",
        "Select or crop by a box",
        "ICON_FA_CUBE",
        "Z",
        lambda parts: BoxTool(parts.session, parts.winners, parts.picker),
        words=("crop", "cube", "volume", "cut out", "bounding box"),
    ),
    ToolRecord(
        "flood",
        "Select what hangs together",
        "ICON_FA_FILL_DRIP",
        "U",
        lambda parts: AlikeTool(parts.session, parts.winners, parts.picker, find_flooded_rows),
    ),
    ToolRecord(
        "eyedropper",
        "Select by colour",
        "ICON_FA_EYE_DROPPER",
        "O",
        lambda parts: AlikeTool(parts.session, parts.winners, parts.picker, find_alike_rows),
    ),
    ToolRecord("move", "Move", "ICON_FA_UP_DOWN_LEFT_RIGHT", "T", _make_handles_tool("move"), starts_group=True),
    ToolRecord("rotate", "Rotate", "ICON_FA_ARROWS_ROTATE", "R", _make_handles_tool("rotate")),
    ToolRecord("scale", "Scale", "ICON_FA_EXPAND", "Y", _make_handles_tool("scale")),
    ToolRecord(
        "path",
        "Edit the way of a vehicle",
        "ICON_FA_ROUTE",
        "Shift+T",
        lambda parts: PathTool(parts.session, parts.picker),
        words=("path", "track", "keys", "drive", "trajectory", "vehicle"),
    ),
    ToolRecord(
        "measure",
        "Measure",
        "ICON_FA_RULER",
        "M",
        lambda parts: MeasureTool(parts.session, parts.winners, parts.picker),
        words=("ruler", "distance", "length", "height", "metres", "tape"),
    ),
)
"""In the toolbar's order."""


def create_tools(session: EditorSession, winners: WinnerReader) -> dict[str, Tool]:
    """Create one tool of each record, by name."""
    parts = ToolParts(session, winners, Picker())
    return {record.name: record.create(parts) for record in TOOLS}
