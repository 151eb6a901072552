"""The editor's window: Dear ImGui on GLFW and OpenGL 3.3, with docked panels, idle while nothing changes."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Thread

import moderngl
import numpy as np
from imgui_bundle import ImVec2, glfw_utils, hello_imgui, imgui
from jaxtyping import UInt8
from numpy import ndarray

from instdrive_app.actions import register_actions
from instdrive_app.even_frames import settle_memory, share_fairly
from instdrive_app.language.languages import ENGLISH, resolve_language
from instdrive_app.language.translation import get_language, speak, translate
from instdrive_app.panels.dialogs import DialogHost
from instdrive_app.panels.dialogs.registry import DIALOGS
from instdrive_app.panels.menus import draw_menus, run_shortcuts
from instdrive_app.panels.registry import PANELS, PanelRecord
from instdrive_app.panels.status import StatusBar
from instdrive_app.panels.toasts import draw_progress, draw_toasts
from instdrive_app.panels.widgets.theme import apply_style, apply_theme, load_fonts
from instdrive_app.panels.widgets.ui import Ui
from instdrive_app.panels.window_menu import list_panel_actions
from instdrive_app.preferences.themes import THEMES
from instdrive_app.render.live_view import LiveView
from instdrive_app.render.picture_textures import PictureTextures
from instdrive_app.render.warm_up import warm_up
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.requests import ReceiveDrop, Request, ShowPanel, do_nothing
from instdrive_app.shell.display import DisplayError, has_display
from instdrive_app.shell.file_drops import accept_drops
from instdrive_app.shell.report import Reporter
from instdrive_app.shell.window_layout import (
    IDLE_FPS,
    WAITING_FPS,
    WindowOptions,
    build_runner_parameters,
)
from instdrive_app.state import Comparison
from instdrive_app.tools.registry import create_tools
from instdrive_core.wording import phrase

_log = logging.getLogger(__name__)


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
        self._dialogs = DialogHost(DIALOGS)
        self._status, self._title, self._theme = StatusBar(), "", ""
        self._labels = {record.title: record.title for record in PANELS}
        """Names of the docked windows, by the panels' titles. Layouts are read and saved under the titles."""
        self._language = (session.preferences.current.language, self._options.language)
        """What was chosen in Preferences when the window's language was last set, and the language asked for."""
        self._read_names: tuple[int, object] | None = None
        """Document and version of the table whose names were looked through."""
        self._told_letters: set[str] = set()
        register_actions(session, list_panel_actions)

    @property
    def ui(self) -> Ui:
        """What panels draw with; available from the first frame on."""
        assert self._ui is not None, "the window is not open yet"
        return self._ui

    @property
    def session(self) -> EditorSession:
        """The session that the window shows."""
        return self._session

    @property
    def answers(self) -> frozenset[type[Request]]:
        """Types of the requests that the window and its dialogs answer."""
        return self._dialogs.answers | {ShowPanel}

    def run(self, script: Callable[[EditorWindow], Iterator[None]] | None = None) -> None:
        """Open the window and return when it closes; a `script` advances by one step a frame, and its end closes it.

        An exception of a panel or the script closes the window and is raised here. Raises DisplayError where no
        window can be opened.
        """
        self._script = script
        try:
            hello_imgui.run(self._build_parameters())
        except RuntimeError as error:  # also where the first frame was cut short; then the stored failure is the cause
            self._failure = self._failure or self._explain(error)
        if self._failure is not None:
            raise self._failure

    def _explain(self, error: RuntimeError) -> BaseException:
        if self._ui is not None:
            return error
        display = os.environ.get("DISPLAY", "not set")
        return DisplayError(
            phrase(
                "the window could not be opened ({error}). It needs a display (DISPLAY is {display}) "
                "and OpenGL 3.3; check the display, or update the graphics driver",
                error=error,
                display=display,
            )
        )

    def screenshot(self) -> Iterator[None]:
        """Yield until `last_screenshot` holds the whole window of a later frame."""
        self._screenshot, self._wants_screenshot = None, True
        while self._screenshot is None:
            yield

    @property
    def last_screenshot(self) -> UInt8[ndarray, "h w 3"]:
        """RGB of the whole window."""
        assert self._screenshot is not None, "no screenshot was asked for"
        return self._screenshot

    # ------------------------------------------------------------------ set-up

    def _build_parameters(self) -> hello_imgui.RunnerParams:
        windows = [self._create_dockable(record) for record in PANELS]
        parameters = build_runner_parameters(self._options, windows)
        calls = parameters.callbacks
        calls.default_icon_font = hello_imgui.DefaultIconFont.font_awesome6
        calls.load_additional_fonts = self._guard(self._create_ui)
        calls.setup_imgui_style = apply_style
        calls.setup_imgui_config = _configure_imgui
        calls.post_init = self._guard(self._create_context)
        calls.pre_new_frame = self._guard(self._before_frame)
        calls.show_menus = self._guard(lambda: draw_menus(self.ui))
        calls.show_status = self._guard(lambda: self._status.draw(self.ui))
        calls.show_gui = self._guard(self._before_panels)
        calls.post_render_dockable_windows = self._guard(self._after_panels)
        calls.before_swap = self._guard(self._before_swap)
        calls.before_exit = self._guard(self._stop)
        return parameters

    def _show_language(self) -> None:
        """Speak the language that the user prefers, from the frame on in which it is chosen."""
        chosen = self._session.preferences.current.language
        before, asked = self._language
        code = asked if asked and chosen == before else resolve_language(chosen)
        self._language = (chosen, asked if chosen == before else "")
        if code != get_language():
            speak(code)
            self._name_windows()

    def _name_windows(self, translated: bool = True) -> None:
        """Write the panels' titles on their tabs; IDs, and with them places, stay those of the English titles."""
        docking = hello_imgui.get_runner_params().docking_params
        for title, label in self._labels.items():
            window = docking.dockable_window_of_name(label)
            if window is not None:
                window.label = self._labels[title] = make_window_name(title) if translated else title

    def _create_dockable(self, record: PanelRecord) -> hello_imgui.DockableWindow:
        panel = record.create()

        def draw() -> None:
            # Meanwhile panels list another scene than the one that is looked at.
            imgui.begin_disabled(self._session.sketches.shown is not None and not record.fills_window)
            panel.draw(self.ui)
            imgui.end_disabled()

        window = hello_imgui.DockableWindow(self._labels[record.title], record.place, self._guard(draw), record.shown)
        window.can_be_closed = not record.shown
        if record.fills_window:
            window.call_begin_end = False
            window.gui_function = self._guard(lambda: _draw_without_padding(self._labels[record.title], draw))
        return window

    def _guard(self, call: Callable[[], None]) -> Callable[[], None]:
        """Wrap a callback: no exception may leave the frame of ImGui. The first one is stored and closes the window."""

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
        """Create what panels draw with; called once, after the context, when fonts can be loaded."""
        view = LiveView(self._context, self._wake)
        self._session.wake_window = self._wake
        tools = create_tools(self._session, lambda snapshot: view.renderer.read_rows(snapshot))
        sketch_view = LiveView(self._context, self._wake, warms_up=False)
        self._ui = Ui(self._session, view, sketch_view, tools, load_fonts(), PictureTextures(self._context))
        self._drops = accept_drops(glfw_utils.glfw_window_hello_imgui(), self._take_drop)
        share_fairly()
        Thread(target=_load_what_is_needed, name="warm-up", daemon=True).start()
        if self._options.report is not None:
            self._reporter = Reporter(self._options.report)

    @staticmethod
    def _wake() -> None:
        """Have a frame drawn now; called from any thread."""
        import glfw  # not before imgui_bundle, which tells it to use the same library

        glfw.post_empty_event()

    def _take_drop(self, paths: tuple[Path, ...]) -> None:
        self._session.requests.put(ReceiveDrop(paths))

    def _before_frame(self) -> None:
        self._show_theme()
        self._show_language()
        self.ui.forget_marks()
        self.ui.textures.free_retired()

    def _show_theme(self) -> None:
        """Show the theme that the user prefers, from the frame on in which it is chosen."""
        theme = self._session.preferences.current.theme
        if theme != self._theme:
            self._theme = theme
            apply_theme(THEMES[theme])

    def _before_panels(self) -> None:
        self._session.tick(imgui.get_io().delta_time)
        self._tell_missing_letters()
        self._show_title()
        run_shortcuts(self.ui)

    def _tell_missing_letters(self) -> None:
        """Say, once for each, which characters of the open scene's names are shown as boxes."""
        document = self._session.document
        if document is None or self._read_names == (id(document), document.versions.table):
            return
        self._read_names = (id(document), document.versions.table)
        words = {word for instance in document.scene.table for word in (instance.name, instance.class_name)}
        foreign = "".join(sorted(word for word in words if not word.isascii()))
        missing = self.ui.fonts.find_missing("".join(letter for letter in foreign if letter not in self._told_letters))
        if missing:
            self._told_letters |= {*missing}
            self._session.messages.info(
                phrase(
                    "No font of this computer has {count} characters of the names ({missing}), which are "
                    "shown as boxes. Install a font that has them, such as Noto Sans CJK, and start the "
                    "editor again",
                    count=len(missing),
                    missing=missing[:6],
                )
            )

    def _show_title(self) -> None:
        """Show the open file, and a dot where it is unsaved, in the desktop's list of windows."""
        title = format_window_title(self._session)
        if title != self._title:
            import glfw  # see above

            glfw.set_window_title(glfw_utils.glfw_window_hello_imgui(), title)  # type: ignore[arg-type]
            self._title = title

    def _is_waiting(self) -> bool:
        """Whether the picture will change soon without an event: progress, the playing drive, a sharper picture."""
        session = self._session
        busy = (
            session.jobs.current is not None
            or session.navigation.playing
            or session.camera_path.playing
            or session.references.is_reading
            or session.difference.is_comparing
            or session.map.is_painting
            or (session.state.compares and session.state.comparison is Comparison.FLICKER)
        )
        busy = busy or session.history.is_jumping
        return busy or not self.ui.view.settled

    def _after_panels(self) -> None:
        while (request := self._session.requests.take(ShowPanel)) is not None:
            self._show_panel(request.panel, request.closes)
            self._dialogs.hold()
        self._dialogs.draw(self.ui)
        draw_progress(self.ui)
        draw_toasts(self.ui)
        self.ui.popup_open = imgui.is_popup_open("", imgui.PopupFlags_.any_popup)
        if self._reporter is not None:
            self._reporter.write(self.ui)
        if self._steps is None and self._script is not None:
            self._steps = self._script(self)
        if self._steps is not None and next(self._steps, _FINISHED) is _FINISHED:
            self._session.is_quitting = True
        parameters = hello_imgui.get_runner_params()
        if parameters.app_shall_exit and not self._session.is_quitting:  # the window's own cross
            self._session.leave()
        parameters.app_shall_exit = self._session.is_quitting
        if parameters.app_shall_exit:  # the layout is saved next
            self._name_windows(translated=False)
        parameters.fps_idling.enable_idling = self._steps is None
        parameters.fps_idling.fps_idle = WAITING_FPS if self._is_waiting() else IDLE_FPS

    def _show_panel(self, name: str, closes: bool) -> None:
        docking = hello_imgui.get_runner_params().docking_params
        label = self._labels.get(name, name)
        window = docking.dockable_window_of_name(label)
        if window is None:
            _log.error("there is no panel %r to show", name)
            return
        window.is_visible = not closes
        if closes:
            return
        docking.focus_dockable_window(label)

    def _before_swap(self) -> None:
        if self._wants_screenshot:
            size, density = imgui.get_io().display_size, imgui.get_io().display_framebuffer_scale
            width, height = round(size.x * density.x), round(size.y * density.y)
            pixels = self._context.detect_framebuffer().read(viewport=(0, 0, width, height), components=3, alignment=1)
            self._screenshot = np.frombuffer(pixels, np.uint8).reshape(height, width, 3)[::-1].copy()
            self._wants_screenshot = False

    def _stop(self) -> None:
        speak(ENGLISH)  # as whatever else this process does
        self._session.wake_window = do_nothing
        if self._ui is not None:
            self._ui.view.release()
            self._ui.sketch_view.release()
            self._ui.textures.release()
        if self._reporter is not None:
            self._reporter.close()
        self._session.close(by_choice=self._failure is None)


_FINISHED = object()


def format_window_title(session: EditorSession) -> str:
    """Format the title, e.g. ``street.instdrive • InstDrive``; the dot stands for unsaved changes."""
    path = session.files.path
    if session.document is None or path is None:
        return "InstDrive"
    return f"{path.name} {'•' if session.files.is_unsaved else '–'} InstDrive"


def make_window_name(title: str) -> str:
    """Name of a panel's window with its title in the window's language, and the ID of the English one.

    English where ImGui (before 1.93) takes a name with a title for another window.
    """
    name = f"{translate(title)}###{title}"
    return name if imgui.internal.im_hash_str(name) == imgui.internal.im_hash_str(title) else title


def require_display() -> None:
    """Raise DisplayError where no window can be opened."""
    if not has_display():
        raise DisplayError(
            "there is no display to open the window on (DISPLAY is not set). "
            "Run it on a desktop, or under a virtual display: xvfb-run instdrive edit SCENE"
        )


def _configure_imgui() -> None:
    io = imgui.get_io()
    io.config_flags |= imgui.ConfigFlags_.docking_enable
    io.config_windows_move_from_title_bar_only = True
    # A press that comes with the mouse's move, as in long frames, waits for the next frame, as that of a finger does.
    # Otherwise it would go to what the mouse left: the picture below a button, or the row before.
    io.add_mouse_source_event(imgui.MouseSource.touch_screen)


def _load_what_is_needed() -> None:
    warm_up()
    settle_memory()


def _draw_without_padding(name: str, draw: Callable[[], None]) -> None:
    """Draw a window of its own without padding, so that the picture fills it."""
    flags = imgui.WindowFlags_.no_scrollbar | imgui.WindowFlags_.no_scroll_with_mouse
    imgui.push_style_var(imgui.StyleVar_.window_padding, ImVec2(0, 0))
    visible = imgui.begin(name, None, flags)[0]
    imgui.pop_style_var()
    if visible:
        draw()
    imgui.end()
