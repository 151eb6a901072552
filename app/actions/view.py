"""What the viewport draws, and where it looks."""

from __future__ import annotations

from collections.abc import Callable

from instdrive_app.action import Action
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.requests import ShowPanel
from instdrive_app.state import ViewMode

VIEW_MODE_ICONS = {
    ViewMode.COLOR: "ICON_FA_PALETTE",
    ViewMode.INSTANCE: "ICON_FA_SHAPES",
    ViewMode.CODEWORD: "ICON_FA_BARCODE",
    ViewMode.DEPTH: "ICON_FA_LAYER_GROUP",
    ViewMode.CENTERS: "ICON_FA_BRAILLE",
    ViewMode.RINGS: "ICON_FA_CIRCLE_NOTCH",
}
VIEW_MODE_WORDS = {
    ViewMode.CENTERS: ("centers", "points", "point cloud", "dots", "splats"),
    ViewMode.RINGS: ("ellipsoids", "ellipses", "outlines of splats", "splats"),
}
"""Other words by which the command palette finds them."""


def list_actions(session: EditorSession) -> list[Action]:
    """List the View menu."""

    def show(mode: ViewMode) -> Callable[[], None]:
        def run() -> None:
            session.state.view_mode = mode

        return run

    def is_shown(mode: ViewMode) -> Callable[[], bool]:
        return lambda: session.state.view_mode is mode

    def fit_map() -> None:
        session.state.map_fits += 1
        session.requests.put(ShowPanel("Map"))

    modes = [
        Action(
            f"view.{mode.name.lower()}",
            mode.value,
            show(mode),
            "View",
            (str(number),),
            checked=is_shown(mode),
            icon=VIEW_MODE_ICONS[mode],
            words=VIEW_MODE_WORDS.get(mode, ()),
        )
        for number, mode in enumerate(ViewMode, start=1)
    ]
    return [
        *modes,
        Action(
            "view.frame",
            "Frame the selection",
            lambda: session.navigation.frame(session.selection.ids),
            "View",
            ("F",),
            enabled=lambda: session.document is not None,
            icon="ICON_FA_EXPAND",
            words=("camera", "zoom", "focus"),
            separator=True,
        ),
        Action(
            "view.frame_all",
            "Frame everything",
            lambda: session.navigation.frame(()),
            "View",
            ("Home",),
            enabled=lambda: session.document is not None,
            icon="ICON_FA_MAXIMIZE",
            words=("camera", "zoom", "fit"),
        ),
        Action(
            "view.start",
            "Start view",
            session.navigation.look_from_start,
            "View",
            ("Ctrl+Home",),
            enabled=lambda: session.document is not None,
            icon="ICON_FA_HOUSE",
            words=("camera", "reset view"),
        ),
        Action(
            "view.birds_eye",
            "Bird's eye",
            lambda: session.navigation.look_down(session.selection.ids),
            "View",
            ("Shift+Home",),
            enabled=lambda: session.document is not None,
            icon="ICON_FA_DOVE",
            words=("camera", "top", "map"),
        ),
        Action(
            "map.frame",
            "Show everything in the map",
            fit_map,
            "View",
            enabled=lambda: session.document is not None,
            icon="ICON_FA_MAP_LOCATION_DOT",
            words=("map", "bird's eye", "plan", "top view", "overview"),
        ),
        _create_switch(session, "view.sky", "Sky", "show_sky", "ICON_FA_CLOUD_SUN", separator=True),
        _create_switch(session, "view.plain_solo", "Plain backdrop when shown alone", "plain_solo", "ICON_FA_SQUARE"),
        _create_switch(session, "view.outlines", "Outlines", "show_outlines", "ICON_FA_VECTOR_SQUARE"),
        _create_switch(session, "view.grid", "Grid on the ground", "show_grid", "ICON_FA_BORDER_ALL", key="Shift+G"),
        *_list_cameras(session),
        _create_switch(
            session, "view.above_ground", "Orbit above the ground only", "stay_above_ground", "ICON_FA_ROAD"
        ),
    ]


def _list_cameras(session: EditorSession) -> list[Action]:
    """List the switches that draw the clip's cameras where they stood."""
    state, words = session.state, ("frusta", "frustum", "rig", "ego", "trajectory", "poses", "photos")

    def has_cameras() -> bool:
        return session.document is not None and bool(session.document.scene.views)

    def toggle() -> None:
        state.show_cameras = not state.show_cameras

    def toggle_all() -> None:
        state.show_all_cameras = not (state.show_cameras and state.show_all_cameras)
        state.show_cameras = True

    needs = "The scene has no cameras"
    return [
        Action(
            "view.cameras",
            "Cameras of the clip",
            toggle,
            "View",
            ("Alt+C",),
            enabled=has_cameras,
            checked=lambda: state.show_cameras,
            icon="ICON_FA_CAMERA",
            words=words,
            needs=needs,
        ),
        Action(
            "view.all_cameras",
            "Cameras of all moments",
            toggle_all,
            "View",
            ("Alt+Shift+C",),
            enabled=has_cameras,
            checked=lambda: state.show_cameras and state.show_all_cameras,
            icon="ICON_FA_CAMERA_RETRO",
            words=words,
            needs=needs,
        ),
    ]


def _create_switch(
    session: EditorSession, command_id: str, title: str, field: str, icon: str, separator: bool = False, key: str = ""
) -> Action:
    def toggle() -> None:
        setattr(session.state, field, not getattr(session.state, field))

    return Action(
        command_id,
        title,
        toggle,
        "View",
        (key,) if key else (),
        checked=lambda: getattr(session.state, field),
        icon=icon,
        separator=separator,
    )
