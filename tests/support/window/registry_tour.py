"""Draws everything that the registries list in the real window: without a scene, and with the street.

``python tests/support/window/registry_tour.py FOLDER`` ends with status 0 where none of them raises and each dialog
opens. FOLDER is for its files; PYTHONPATH must name tests/support.
"""

import os
import sys
from pathlib import Path

from example_requests import fill_in, list_requests
from imgui_bundle import imgui
from procedural_street import FIRST_CAR, procedural_street

from instdrive_app.panels.dialogs import file_browser
from instdrive_app.panels.overlays.registry import OVERLAYS
from instdrive_app.panels.registry import PANELS
from instdrive_app.panels.widgets.ui import Rectangle
from instdrive_app.pointer import Click
from instdrive_app.render.picking import Picker
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.requests import AskClass, AskName, AskSplit, ReceiveDrop, ShowPanel
from instdrive_app.shell.virtual_display import open_virtual_display
from instdrive_app.shell.window import EditorWindow
from instdrive_app.shell.window_layout import WindowOptions
from instdrive_app.state import ViewMode
from instdrive_app.tools.registry import TOOLS, ToolParts
from instdrive_core.edits.document.document import Document
from instdrive_core.formats.registry import save_scene

FRAMES = 3
GONE = 999
"""An instance that an undo has taken away meanwhile."""
PLACE = Rectangle(300, 100, 400, 300)


def play(window, scene):
    """Everything without a scene, then everything with one."""
    yield from wait(FRAMES)
    yield from draw_everything(window, scene)
    window.session.show(Document(procedural_street()), scene)
    while window.ui.view.snapshot is None:
        yield
    window.session.selection.select((FIRST_CAR,))
    for mode in ViewMode:
        window.session.state.view_mode = mode
        yield from wait(FRAMES)
    yield from draw_everything(window, scene)
    yield from use_tools(window)
    assert window.ui.view.gl_error is None


def draw_everything(window, scene):
    """Panels and overlays that are made for this, and the window's own dialogs."""
    for record in PANELS:
        yield from draw_in_window(record.title, record.create(), window.ui)
        window.session.requests.put(ShowPanel(record.title))
        yield from wait(FRAMES)
    for record in OVERLAYS:
        yield from draw_in_window(record.title, record.create(), window.ui, PLACE)
    fill_in(window.session, scene)
    for name, request in list_requests(scene, FIRST_CAR).items():
        if isinstance(request, ReceiveDrop) and window.session.document is None:
            continue  # it would open the scene
        window._dialogs.open(window.ui, request)
        yield from wait(FRAMES)
        is_open = imgui.is_popup_open("", imgui.PopupFlags_.any_popup)
        assert is_open or window.session.document is None, f"the dialog for {name} does not open"
        while imgui.is_popup_open("", imgui.PopupFlags_.any_popup):
            yield from press_escape()
    window.session.files.autosave.recoverable = []
    for request in (AskClass((GONE,)), AskSplit(GONE), AskName(GONE)):
        window._dialogs.open(window.ui, request)
        yield from wait(FRAMES)
        assert not imgui.is_popup_open("", imgui.PopupFlags_.any_popup), f"{request} opens, and there is no such one"


def draw_in_window(title, drawn, ui, *place):
    """Draw it over some frames, in a window of its own."""
    for _ in range(FRAMES):
        imgui.set_next_window_size((600, 400))
        imgui.begin(f"{title} on its own")
        drawn.draw(ui, *place)
        imgui.end()
        yield


def use_tools(window):
    """Take each tool, so that its options and handles are drawn, and use one made for this."""
    session, snapshot = window.session, window.ui.view.snapshot
    parts = ToolParts(session, lambda shown: window.ui.view.renderer.read_rows(shown), Picker())
    for record in TOOLS:
        assert session.actions.run(f"tool.{record.name}")
        yield from wait(FRAMES)
        tool = record.create(parts)
        tool.hover(100.0, 100.0, snapshot)
        tool.click(Click(100.0, 100.0), snapshot)
        tool.drag((50.0, 50.0), (150.0, 120.0))
        tool.drag((50.0, 50.0), (60.0, 150.0))
        tool.release(Click(60.0, 150.0), snapshot)
        tool.cancel()
        tool.leave()
        yield


def press_escape():
    """Press and release Escape."""
    for down in (True, False):
        imgui.get_io().add_key_event(imgui.Key.escape, down)
        yield from wait(2)


def wait(frames):
    """Let the window draw some frames."""
    for _ in range(frames):
        yield


def main(folder):
    """Open the window and play."""
    os.environ["INSTDRIVE_STATE"] = str(folder / "state")
    file_browser.has_desktop_dialogs = lambda: False
    scene = folder / "street"
    save_scene(scene, procedural_street())
    with open_virtual_display((1280, 720)):
        window = EditorWindow(EditorSession(), WindowOptions((1280, 720), remember_layout=False))
        window.run(lambda _: play(window, scene))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
