"""Taking a tool, and options of the region tools."""

from __future__ import annotations

from collections.abc import Callable

from instdrive_app.action import Action
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.tools.registry import TOOLS, ToolRecord

HANDLES = frozenset({"move", "rotate", "scale"})
"""Tools that act on instances at once: selected splats of none become one."""
BRUSH_RADII, BRUSH_DEPTHS, TOLERANCES = (2.0, 400.0), (0.0625, 512.0), (0.01, 1.0)
"""Least and most: pixels, metres behind what is seen, and differences of colours."""


def list_actions(session: EditorSession) -> list[Action]:
    """List the Tools menu."""
    state = session.state

    def select_splats(on: bool) -> Callable[[], None]:
        def run() -> None:
            state.region_splats = on

        return run

    def toggle_visible_only() -> None:
        state.region_visible_only = not state.region_visible_only

    return [
        *(_create_tool_action(session, record) for record in TOOLS),
        Action(
            "tool.whole_instances",
            "Regions select whole instances",
            select_splats(False),
            "Tools",
            checked=lambda: not state.region_splats,
            icon="ICON_FA_SHAPES",
            separator=True,
        ),
        Action(
            "tool.single_splats",
            "Regions select single splats",
            select_splats(True),
            "Tools",
            checked=lambda: state.region_splats,
            icon="ICON_FA_BRAILLE",
        ),
        Action(
            "tool.visible_only",
            "Regions select visible splats only",
            toggle_visible_only,
            "Tools",
            checked=lambda: state.region_visible_only,
            icon="ICON_FA_EYE",
        ),
        *_list_measures(session),
    ]


def _list_measures(session: EditorSession) -> list[Action]:
    """List what changes the brush, its radius and depth, and how alike colours must be."""

    def scale(field: str, factor: float, low: float, high: float) -> Callable[[], None]:
        def run() -> None:
            setattr(session.state, field, min(max(getattr(session.state, field) * factor, low), high))

        return run

    sizes = (
        ("brush.smaller", "Smaller brush", "[", "ICON_FA_MINUS", scale("brush_radius", 0.8, *BRUSH_RADII)),
        ("brush.larger", "Larger brush", "]", "ICON_FA_PLUS", scale("brush_radius", 1.25, *BRUSH_RADII)),
        ("brush.shallower", "Shallower brush", "Shift+[", "ICON_FA_ARROW_UP", scale("brush_depth", 0.5, *BRUSH_DEPTHS)),
        ("brush.deeper", "Deeper brush", "Shift+]", "ICON_FA_ARROW_DOWN", scale("brush_depth", 2.0, *BRUSH_DEPTHS)),
        ("alike.stricter", "Stricter colours", "Alt+[", "ICON_FA_MINUS", scale("color_tolerance", 0.8, *TOLERANCES)),
        ("alike.looser", "Looser colours", "Alt+]", "ICON_FA_PLUS", scale("color_tolerance", 1.25, *TOLERANCES)),
    )
    return [
        Action(
            name,
            title,
            run,
            "Tools",
            (key,),
            icon=icon,
            separator=name == "brush.smaller",
            words=("brush size", "tolerance"),
        )
        for name, title, key, icon, run in sizes
    ]


def _create_tool_action(session: EditorSession, record: ToolRecord) -> Action:
    def take() -> None:
        session.state.tool = record.name
        if record.name in HANDLES and not session.selection.is_empty:
            session.selection.name_loose_splats()

    return Action(
        f"tool.{record.name}",
        record.title,
        take,
        "Tools",
        (record.shortcut,),
        checked=lambda: session.state.tool == record.name,
        icon=record.icon,
        separator=record.starts_group,
        words=record.words,
    )
