"""Taking a tool, and options of the region tools."""

from __future__ import annotations

from collections.abc import Callable

from instdrive_app.action import Action
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.tools.registry import TOOLS, ToolRecord


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
    ]


def _create_tool_action(session: EditorSession, record: ToolRecord) -> Action:
    def take() -> None:
        session.state.tool = record.name

    return Action(
        f"tool.{record.name}",
        record.title,
        take,
        "Tools",
        (record.shortcut,),
        checked=lambda: session.state.tool == record.name,
        icon=record.icon,
        separator=record.starts_group,
    )
