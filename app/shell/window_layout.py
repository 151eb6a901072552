"""How the window opens, and where its panels are until the user moves them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from imgui_bundle import hello_imgui, imgui

RIGHT_WIDTH, BOTTOM_HEIGHT = 346.0, 104.0
"""Smallest width of the lists at the right and height of the timeline, in pixels at scale 1."""
INSPECTOR_SHARE = 0.6
"""Share of the right column; the list of instances has the rest."""
BESIDE_SHARE = 0.36
"""Share of the view's width that panels beside it take."""
IDLE_FPS, WAITING_FPS = 1.0, 20.0
"""Frames per second while the user does nothing, and while a job runs; events and results wake the window at once."""


@dataclass(frozen=True)
class WindowOptions:
    """How the window opens."""

    size: tuple[int, int] = (1280, 720)
    """Width and height, at scale 1."""
    report: Path | None = None
    """File for the window's state as JSON lines."""
    remember_layout: bool = True
    scale: float = 0.0
    """Size of text and widgets; 0 = as the monitor reports."""
    language: str = ""
    """Code of the window's language until another is chosen in Preferences; empty: as chosen there before."""


def build_runner_parameters(
    options: WindowOptions, windows: Sequence[hello_imgui.DockableWindow]
) -> hello_imgui.RunnerParams:
    """Build everything that is fixed before the window opens; the caller sets the callbacks."""
    parameters = hello_imgui.RunnerParams()
    window = parameters.app_window_params
    window.window_title = "InstDrive"
    window.window_geometry.size = options.size
    window.restore_previous_geometry = options.remember_layout
    if options.scale:
        parameters.dpi_aware_params.dpi_window_size_factor = options.scale
    shown = parameters.imgui_window_params
    shown.default_imgui_window_type = hello_imgui.DefaultImGuiWindowType.provide_full_screen_dock_space
    shown.show_menu_bar, shown.show_menu_app, shown.show_menu_view = True, False, False
    shown.show_status_bar, shown.show_status_fps, shown.remember_status_bar_settings = True, False, False
    shown.remember_theme = False
    parameters.docking_params = _build_docking(options.size, windows)
    parameters.fps_idling.fps_idle = IDLE_FPS
    parameters.fps_idling.time_active_after_last_event = 0.5
    parameters.renderer_backend_options.open_gl_options = _build_open_gl_options()
    parameters.ini_folder_type = hello_imgui.IniFolderType.app_user_config_folder
    parameters.ini_filename = "instdrive/window.ini"
    parameters.ini_disable = not options.remember_layout
    _keep_drags_for_widgets(parameters)
    return parameters


def _keep_drags_for_widgets(parameters: hello_imgui.RunnerParams) -> None:
    """Keep presses from scrolling panels as fingers do: the mouse counts as touching (`_configure_imgui`).

    Else a press in a panel that can be scrolled would reach its widgets as a click, once over, and never as a drag.
    """
    if hasattr(parameters, "touch_scroll_mode"):  # since 1.93 of imgui-bundle
        parameters.touch_scroll_mode = hello_imgui.TouchScrollMode.disabled
        parameters.touch_long_press_is_right_click = parameters.touch_thin_scrollbars = False


def _build_docking(size: tuple[int, int], windows: Sequence[hello_imgui.DockableWindow]) -> hello_imgui.DockingParams:
    split, direction = hello_imgui.DockingSplit, imgui.Dir
    docking, (width, height) = hello_imgui.DockingParams(), size
    docking.docking_splits = [
        split("MainDockSpace", "Right", direction.right, max(RIGHT_WIDTH / width, 0.23)),
        split("Right", "RightBottom", direction.down, INSPECTOR_SHARE),
        split("MainDockSpace", "Bottom", direction.down, max(BOTTOM_HEIGHT / height, 0.13)),
        split("MainDockSpace", "Beside", direction.right, BESIDE_SHARE),
    ]
    docking.dockable_windows = list(windows)
    docking.main_dock_space_node_flags = imgui.DockNodeFlags_.auto_hide_tab_bar
    docking.layout_condition = hello_imgui.DockingLayoutCondition.first_use_ever
    return docking


def _build_open_gl_options() -> hello_imgui.OpenGlOptions:
    options = hello_imgui.OpenGlOptions()
    options.major_version, options.minor_version = 3, 3
    options.use_core_profile = options.use_forward_compat = True
    options.anti_aliasing_samples = 0
    return options
