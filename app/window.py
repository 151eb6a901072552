"""The window: Dear ImGui on GLFW and OpenGL 3.3, docked panels, idle while nothing changes."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from threading import Thread

import moderngl
import numpy as np
from imgui_bundle import ImVec2, glfw_utils, hello_imgui, imgui
from jaxtyping import UInt8
from numpy import ndarray

from instdrive_app.actions import register_commands
from instdrive_app.panels.dialogs import DialogHost
from instdrive_app.panels.dialogs.about import AboutDialog
from instdrive_app.panels.dialogs.changed_scene import ChangedSceneDialog
from instdrive_app.panels.dialogs.dropped import DroppedDialog
from instdrive_app.panels.dialogs.file_browser import FileBrowser
from instdrive_app.panels.dialogs.findings import FindingsDialog
from instdrive_app.panels.dialogs.palette import CommandPalette
from instdrive_app.panels.dialogs.reassign import ReassignDialog
from instdrive_app.panels.dialogs.recovery import RecoveryDialog
from instdrive_app.panels.dialogs.rename import RenameDialog
from instdrive_app.panels.dialogs.set_class import ClassDialog
from instdrive_app.panels.dialogs.shortcuts import ShortcutSheet
from instdrive_app.panels.dialogs.split import SplitDialog
from instdrive_app.panels.dialogs.too_large import TooLargeDialog
from instdrive_app.panels.dialogs.unsaved import UnsavedDialog
from instdrive_app.panels.history import HistoryPanel
from instdrive_app.panels.inspector import InspectorPanel
from instdrive_app.panels.instances import InstancesPanel
from instdrive_app.panels.log import LogPanel
from instdrive_app.panels.menus import draw_menus, run_shortcuts
from instdrive_app.panels.overlays.camera_tag import CameraTag
from instdrive_app.panels.overlays.deletion import DeletionOverlay
from instdrive_app.panels.overlays.depth_legend import DepthLegend
from instdrive_app.panels.overlays.gizmo import Gizmo
from instdrive_app.panels.overlays.hover_label import HoverLabel
from instdrive_app.panels.overlays.opacity_slider import OpacitySlider
from instdrive_app.panels.overlays.region_outline import RegionOutline
from instdrive_app.panels.overlays.view_switch import ViewSwitch
from instdrive_app.panels.status import StatusBar
from instdrive_app.panels.timeline import TimelinePanel
from instdrive_app.panels.toasts import draw_progress, draw_toasts
from instdrive_app.panels.toolbar import Toolbar
from instdrive_app.panels.ui import Ui
from instdrive_app.panels.viewport import ViewportPanel
from instdrive_app.render.live_view import LiveView
from instdrive_app.render.picture_textures import PictureTextures
from instdrive_app.render.warm_up import warm_up
from instdrive_app.report import Reporter
from instdrive_app.session import EditorSession
from instdrive_app.theme import apply_style, load_fonts
from instdrive_app.tools.registry import created_tools
from instdrive_app.virtual_display import DisplayError, has_display

RIGHT_WIDTH, BOTTOM_HEIGHT = 346.0, 104.0
"""What the lists at the right and the timeline need at least, in pixels at scale 1."""
INSPECTOR_SHARE = 0.6
"""Of the right column; instances have the rest."""
IDLE_FPS, WAITING_FPS = 1.0, 20.0
"""Frames per second while the user does nothing, and while something is under way; any event wakes the window at once,
and so does a result."""


@dataclass(frozen=True)
class WindowOptions:
    """How the window opens."""

    size: tuple[int, int] = (1280, 720)
    """Width and height, at scale 1."""
    report: Path | None = None
    """Where to write the window's state as JSON lines."""
    remember_layout: bool = True
    scale: float = 0.0
    """How large text and widgets are drawn; 0 = as the monitor says."""


class EditorWindow:
    """Runs a session in a window until the user quits."""

    def __init__(self, session: EditorSession, options: WindowOptions | None = None) -> None:
        self._session, self._options = session, options or WindowOptions()
        self._script: Callable[[EditorWindow], Iterator[None]] | None = None
        self._steps: Iterator[None] | None = None
        self._ui: Ui | None = None
        self._reporter: Reporter | None = None
        self._failure: BaseException | None = None
        self._screenshot: UInt8[ndarray, "h w 3"] | None = None
        self._wants_screenshot = False
        self._dialogs = DialogHost(
            (
                FileBrowser(),
                RenameDialog(),
                ClassDialog(),
                SplitDialog(),
                ReassignDialog(),
                ShortcutSheet(),
                AboutDialog(),
                CommandPalette(),
                UnsavedDialog(),
                RecoveryDialog(),
                DroppedDialog(),
                ChangedSceneDialog(),
                TooLargeDialog(),
                FindingsDialog(),
            )
        )
        self._panels = {
            "View": ViewportPanel(
                (
                    DeletionOverlay(),
                    Gizmo(),
                    ViewSwitch(),
                    Toolbar(),
                    CameraTag(),
                    DepthLegend(),
                    OpacitySlider(),
                    HoverLabel(),
                    RegionOutline(),
                )
            ),
            "Instances": InstancesPanel(),
            "Inspector": InspectorPanel(),
            "History": HistoryPanel(),
            "Timeline": TimelinePanel(),
            "Log": LogPanel(),
        }
        self._status, self._title = StatusBar(), ""
        register_commands(session)

    @property
    def ui(self) -> Ui:
        """Available from the first frame on."""
        assert self._ui is not None, "the window is not open yet"
        return self._ui

    @property
    def session(self) -> EditorSession:
        """The session that the window shows."""
        return self._session

    @property
    def dialogs(self) -> frozenset[str]:
        """Names of the dialogs that can be asked for."""
        return self._dialogs.names

    def run(self, script: Callable[[EditorWindow], Iterator[None]] | None = None) -> None:
        """Open the window and return when it closes. A `script` is advanced by one step a frame; its end closes it.

        What a panel or the script raises closes the window and is raised here. Raises DisplayError where no window
        can be opened.
        """
        self._script = script
        try:
            hello_imgui.run(self._parameters())
        except RuntimeError as error:  # also where a first frame was cut short: then the failure kept is the cause
            self._failure = self._failure or self._explained(error)
        if self._failure is not None:
            raise self._failure

    def _explained(self, error: RuntimeError) -> BaseException:
        if self._ui is not None:
            return error
        display = os.environ.get("DISPLAY", "not set")
        return DisplayError(
            f"the window could not be opened ({error}). It needs a display (DISPLAY is {display}) and OpenGL 3.3; "
            "check the display, or update the graphics driver"
        )

    def screenshot(self) -> Iterator[None]:
        """Yields until `last_screenshot` holds the whole window of a later frame."""
        self._screenshot, self._wants_screenshot = None, True
        while self._screenshot is None:
            yield

    @property
    def last_screenshot(self) -> UInt8[ndarray, "h w 3"]:
        """RGB of the whole window."""
        assert self._screenshot is not None, "no screenshot was asked for"
        return self._screenshot

    # ------------------------------------------------------------------ set-up

    def _parameters(self) -> hello_imgui.RunnerParams:
        parameters = hello_imgui.RunnerParams()
        window = parameters.app_window_params
        window.window_title = "InstDrive"
        window.window_geometry.size = self._options.size
        window.restore_previous_geometry = self._options.remember_layout
        if self._options.scale:
            parameters.dpi_aware_params.dpi_window_size_factor = self._options.scale
        shown = parameters.imgui_window_params
        shown.default_imgui_window_type = hello_imgui.DefaultImGuiWindowType.provide_full_screen_dock_space
        shown.show_menu_bar, shown.show_menu_app, shown.show_menu_view = True, False, False
        shown.show_status_bar, shown.show_status_fps, shown.remember_status_bar_settings = True, False, False
        shown.remember_theme = False
        calls = parameters.callbacks
        calls.default_icon_font = hello_imgui.DefaultIconFont.font_awesome6
        calls.load_additional_fonts = self._guarded(self._create_ui)
        calls.setup_imgui_style = apply_style
        calls.setup_imgui_config = _configure
        calls.post_init = self._guarded(self._create_context)
        calls.pre_new_frame = self._guarded(self._before_frame)
        calls.show_menus = self._guarded(lambda: draw_menus(self.ui))
        calls.show_status = self._guarded(lambda: self._status.draw(self.ui))
        calls.show_gui = self._guarded(self._before_panels)
        calls.post_render_dockable_windows = self._guarded(self._after_panels)
        calls.before_swap = self._guarded(self._before_swap)
        calls.before_exit = self._guarded(self._stop)
        parameters.docking_params = self._layout()
        parameters.fps_idling.fps_idle = IDLE_FPS
        parameters.fps_idling.time_active_after_last_event = 0.5
        parameters.renderer_backend_options.open_gl_options = _open_gl_options()
        parameters.ini_folder_type = hello_imgui.IniFolderType.app_user_config_folder
        parameters.ini_filename = "instdrive/window.ini"
        parameters.ini_disable = not self._options.remember_layout
        return parameters

    def _layout(self) -> hello_imgui.DockingParams:
        split, direction = hello_imgui.DockingSplit, imgui.Dir
        docking = hello_imgui.DockingParams()
        width, height = self._options.size
        docking.docking_splits = [
            split("MainDockSpace", "Right", direction.right, max(RIGHT_WIDTH / width, 0.23)),
            split("Right", "RightBottom", direction.down, INSPECTOR_SHARE),
            split("MainDockSpace", "Bottom", direction.down, max(BOTTOM_HEIGHT / height, 0.13)),
        ]
        places = {
            "View": "MainDockSpace",
            "Instances": "Right",
            "Inspector": "RightBottom",
            "History": "RightBottom",
            "Timeline": "Bottom",
            "Log": "Bottom",
        }
        docking.dockable_windows = [self._dockable(name, place) for name, place in places.items()]
        docking.main_dock_space_node_flags = imgui.DockNodeFlags_.auto_hide_tab_bar
        docking.layout_condition = hello_imgui.DockingLayoutCondition.first_use_ever
        return docking

    def _dockable(self, name: str, place: str) -> hello_imgui.DockableWindow:
        panel = self._panels[name]
        window = hello_imgui.DockableWindow(name, place, self._guarded(lambda: panel.draw(self.ui)))
        window.can_be_closed = False
        if name == "View":  # the picture goes to the edges: it begins its own window, without padding
            window.call_begin_end = False
            window.gui_function = self._guarded(self._draw_view)
        return window

    def _draw_view(self) -> None:
        flags = imgui.WindowFlags_.no_scrollbar | imgui.WindowFlags_.no_scroll_with_mouse
        imgui.push_style_var(imgui.StyleVar_.window_padding, ImVec2(0, 0))
        visible = imgui.begin("View", None, flags)[0]
        imgui.pop_style_var()
        if visible:
            self._panels["View"].draw(self.ui)
        imgui.end()

    def _guarded(self, call: Callable[[], None]) -> Callable[[], None]:
        """ImGui's frame cannot be left by an exception: keep the first one, draw nothing more, and close the window."""

        def guarded() -> None:
            if self._failure is not None:
                return
            try:
                call()
            except BaseException as error:
                self._failure = error
                hello_imgui.get_runner_params().app_shall_exit = True

        return guarded

    # ------------------------------------------------------------------ frames

    def _create_context(self) -> None:
        self._context = moderngl.create_context(require=330)

    def _create_ui(self) -> None:
        """Called once, after the context, when fonts can be loaded."""
        view = LiveView(self._context, self._wake)
        self._session.wake = self._wake
        tools = created_tools(self._session, lambda snapshot: view.renderer.rows(snapshot))
        self._ui = Ui(self._session, view, tools, load_fonts(), PictureTextures(self._context))
        self._accept_drops()
        Thread(target=warm_up, name="warm-up", daemon=True).start()
        if self._options.report is not None:
            self._reporter = Reporter(self._options.report)

    @staticmethod
    def _wake() -> None:
        """Called from any thread: a frame is to be drawn now."""
        import glfw  # not before imgui_bundle, which tells it to use the same library

        glfw.post_empty_event()

    def _accept_drops(self) -> None:
        import glfw  # not before imgui_bundle, which tells it to use the same library

        def take(_: object, paths: list[str]) -> None:
            if paths:
                self._session.dropped = Path(paths[0])

        glfw.set_drop_callback(glfw_utils.glfw_window_hello_imgui(), take)  # type: ignore[arg-type]

    def _before_frame(self) -> None:
        self.ui.forget_marks()
        self.ui.textures.free_retired()

    def _before_panels(self) -> None:
        self._session.tick(imgui.get_io().delta_time)
        self._show_title()
        run_shortcuts(self.ui)

    def _show_title(self) -> None:
        """What is open, and a dot where it is unsaved, for the desktop's list of windows."""
        title = title_of(self._session)
        if title != self._title:
            import glfw  # see above

            glfw.set_window_title(glfw_utils.glfw_window_hello_imgui(), title)  # type: ignore[arg-type]
            self._title = title

    def _is_waiting(self) -> bool:
        """Whether something is to be seen soon without an event: progress, another moment, a sharper picture."""
        session = self._session
        busy = session.jobs.current is not None or session.navigation.playing or session.references.reading
        return busy or not self.ui.view.settled

    def _after_panels(self) -> None:
        if self._session.panel is not None:
            hello_imgui.get_runner_params().docking_params.focus_dockable_window(self._session.panel)
            self._session.panel = None
        self._dialogs.draw(self.ui)
        draw_progress(self.ui)
        draw_toasts(self.ui)
        self.ui.popup_open = imgui.is_popup_open("", imgui.PopupFlags_.any_popup)
        if self._reporter is not None:
            self._reporter.write(self.ui)
        if self._steps is None and self._script is not None:
            self._steps = self._script(self)
        if self._steps is not None and next(self._steps, _FINISHED) is _FINISHED:
            self._session.quitting = True
        parameters = hello_imgui.get_runner_params()
        if parameters.app_shall_exit and not self._session.quitting:  # the window's own cross
            self._session.leave(self._session.quit)
        parameters.app_shall_exit = self._session.quitting
        parameters.fps_idling.enable_idling = self._steps is None
        parameters.fps_idling.fps_idle = WAITING_FPS if self._is_waiting() else IDLE_FPS

    def _before_swap(self) -> None:
        if self._wants_screenshot:
            size = imgui.get_io().display_size
            width, height = int(size.x), int(size.y)
            pixels = self._context.detect_framebuffer().read(viewport=(0, 0, width, height), components=3, alignment=1)
            self._screenshot = np.frombuffer(pixels, np.uint8).reshape(height, width, 3)[::-1].copy()
            self._wants_screenshot = False

    def _stop(self) -> None:
        self._session.wake = lambda: None
        if self._ui is not None:
            self._ui.view.release()
            self._ui.textures.release()
        if self._reporter is not None:
            self._reporter.close()
        self._session.close(by_choice=self._failure is None)


_FINISHED = object()


def title_of(session: EditorSession) -> str:
    """``street.instdrive • InstDrive``: the dot stands for unsaved changes."""
    path = session.files.path
    if session.document is None or path is None:
        return "InstDrive"
    return f"{path.name} {'•' if session.is_unsaved else '–'} InstDrive"


def require_display() -> None:
    """Raise DisplayError where no window can be opened."""
    if not has_display():
        raise DisplayError(
            "there is no display to open the window on (DISPLAY is not set); "
            "run it on a desktop, or under a virtual display: xvfb-run instdrive edit SCENE"
        )


def _configure() -> None:
    io = imgui.get_io()
    io.config_flags |= imgui.ConfigFlags_.docking_enable
    io.config_windows_move_from_title_bar_only = True


def _open_gl_options() -> hello_imgui.OpenGlOptions:
    options = hello_imgui.OpenGlOptions()
    options.major_version, options.minor_version = 3, 3
    options.use_core_profile = options.use_forward_compat = True
    options.anti_aliasing_samples = 0
    return options
