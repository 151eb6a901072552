"""A tour through the editor's states in a window of a given size: where every widget is, and pictures of them.

``python tests/support/window/look_tour.py OUT --scene SCENE --size 1280 720 --pictures`` writes OUT/looks.json,
OUT/texts.json with all that was drawn, and a PNG per state.
"""

import json
import os
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from drawn_texts import record_texts
from example_requests import fill_in, list_requests, write_example_job
from imgui_bundle import imgui
from PIL import Image
from tyro.conf import Positional

from instdrive_app.camera import orbit
from instdrive_app.panels.registry import PANELS
from instdrive_app.preferences.themes import DEFAULT_THEME
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.export_kinds import KINDS
from instdrive_app.session.requests import AskExport, ReceiveDrop, ShowPanel
from instdrive_app.session.turn_controller import TurnOffer
from instdrive_app.shell.virtual_display import open_virtual_display
from instdrive_app.shell.window import EditorWindow
from instdrive_app.shell.window_layout import WindowOptions
from instdrive_app.state import Comparison, Reference, Stack, ViewMode
from instdrive_core.scene.up_estimate import UpEstimate

LONG_NAME = ("A parked delivery van with a rather long name, behind the second lamp post, " * 3)[:200]
"""The longest name allowed."""
PATIENCE_FRAMES = 400


@dataclass(frozen=True)
class Options:
    """Where to write, and in what window to look."""

    out: Positional[Path]
    scene: Path
    """Scene with at least one photo, which nobody else uses."""
    size: tuple[int, int] = (1280, 720)
    scale: float = 1.0
    theme: str = DEFAULT_THEME
    language: str = "en"
    pictures: bool = False
    only: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """States to visit; default: all."""


class Tour:
    """Visits the states one by one; each leaves the window as it was."""

    def __init__(self, window: EditorWindow, options: Options) -> None:
        self._window, self._session, self._options, self._scene = window, window.session, options, options.scene
        self.states: dict[str, dict] = {}

    def play(self) -> Iterator[None]:
        """All states that are asked for."""
        self._session.preferences.change(theme=self._options.theme)
        yield from self._frames(6)
        yield from self._look("empty")
        self._session.files.open(self._scene)
        while self._session.document is None:
            yield
        yield from self._frames(4)
        yield from self._look("toasts", lambda: self._session.messages.error(f"{LONG_NAME}: {'word ' * 40}"))
        self._session.messages.dismiss()
        yield from self._look("open")
        yield from self._selections()
        yield from self._tools_and_panels()
        yield from self._questions()
        yield from self._driving()
        yield from self._views()
        yield from self._dialogs()
        yield from self._menus()

    def _selections(self) -> Iterator[None]:
        session, ids = self._session, self._cars()
        yield from self._look("one", lambda: session.selection.select(ids[:1]))
        yield from self._look("two", lambda: session.selection.select(ids[:2]))
        session.selection.select(ids[:1])
        session.labels.rename(ids[0], LONG_NAME)
        yield from self._look("long name")
        yield from self._look("move tool", lambda: session.actions.run("tool.move"))
        yield from self._look("region tool", lambda: session.actions.run("tool.rectangle"))
        session.actions.run("tool.pick")
        yield from self._look("history", lambda: self._front("History"))
        yield from self._look("log", lambda: self._front("Log"))
        self._front("Inspector")
        self._front("Timeline")

    def _tools_and_panels(self) -> Iterator[None]:
        session = self._session
        for name in self._window.ui.tools:
            session.actions.run(f"tool.{name}")
            yield from self._look(f"tool {name}")
        session.actions.run("tool.pick")
        for record in PANELS:
            if self._wanted(f"panel {record.title}"):
                session.requests.put(ShowPanel(record.title))
                yield from self._look(f"panel {record.title}", frames=8)
        session.requests.put(ShowPanel("Map", closes=True))
        if self._wanted("panel Training, running"):
            write_example_job(self._options.out / "a run")
            session.making.follow(self._options.out / "a run")
            session.requests.put(ShowPanel("Training"))
            yield from self._look("panel Training, running", frames=40)
        self._front("Inspector")
        self._front("Timeline")
        session.state.shows_first_steps = True
        yield from self._look("first steps")
        session.state.shows_first_steps = False

    def _questions(self) -> Iterator[None]:
        """What lies over the picture after something was done."""
        session, ids = self._session, self._cars()
        session.selection.select(ids[:1])
        if self._wanted("deletion review"):
            session.deletion.delete(ids[1:2])
            yield from self._until(lambda: session.deletion.review.findings is not None)
            yield from self._look("deletion review")
            session.history.undo()
            session.messages.dismiss()
        if self._wanted("solo"):
            session.visibility.solo.enter(ids[:1])
            yield from self._look("solo")
            session.visibility.solo.leave()
        offer = TurnOffer(UpEstimate(np.array([0.0, -1.0, 0.0]), True, "the ground"))
        session.orientation.offer = offer
        yield from self._look("upright bar")
        session.orientation.dismiss_offer()
        session.selection.select(ids[:1])
        snapshot = self._window.ui.view.snapshot
        assert snapshot is not None
        session.state.stack = Stack(ids[:6], 0, (200.0, 150.0), snapshot.camera.world_from_camera.tobytes())
        self._window.ui.script_pointer = (1.0, 1.0)
        yield from self._look("stack")
        session.state.stack, self._window.ui.script_pointer = None, None
        session.aids.box.place(session.state.viewpoint.pivot, 10.0, 0)
        session.actions.run("tool.box")
        yield from self._look("box")
        session.actions.run("box.remove")
        for shift in (0.0, 3.0):
            session.aids.ruler.add(session.state.viewpoint.pivot + shift)
        session.actions.run("tool.measure")
        yield from self._look("ruler")
        session.aids.ruler.clear()
        session.state.show_grid = True
        yield from self._look("grid")
        session.state.show_grid = False
        session.actions.run("tool.pick")

    def _driving(self) -> Iterator[None]:
        """Cameras, the map, and the keys of a way."""
        session, state, document = self._session, self._session.state, self._session.document
        assert document is not None
        session.navigation.look_down(())
        state.show_cameras = state.show_all_cameras = True
        yield from self._look("cameras")
        state.show_cameras = state.show_all_cameras = False
        if any(self._wanted(name) for name in ("way", "map")):
            mover = next(entry.id for entry in document.scene.table if entry.node)
            session.selection.select((mover,))
            session.actions.run("tool.path")
            for place in ((0.0, 4.0), (0.5, 9.0)):
                session.ego_way.add(*place)
            session.ego_way.is_drawing = True
            session.requests.put(ShowPanel("Way"))
            session.requests.put(ShowPanel("Map"))
            yield from self._frames(8)
            yield from self._until(lambda: not session.map.is_painting)
            yield from self._look("way", frames=8)
            session.requests.put(ShowPanel("Map", closes=True))
            session.ego_way.forget()
        session.actions.run("tool.pick")
        self._front("Inspector")
        session.navigation.look_from_start()
        session.selection.select(self._cars()[:1])

    def _views(self) -> Iterator[None]:
        session, state = self._session, self._session.state
        if self._wanted("camera path"):
            yield from self._film()
        for mode in (ViewMode.DEPTH, ViewMode.INSTANCE, ViewMode.CODEWORD, ViewMode.CENTERS, ViewMode.RINGS):
            state.view_mode = mode
            yield from self._look(f"{mode.value.lower()} view")
        state.view_mode = ViewMode.COLOR
        session.navigation.look_through(0)
        yield from self._look("camera")
        state.reference = Reference.PHOTO
        yield from self._look("photo over")
        for comparison in (Comparison.WIPE, Comparison.FLICKER, Comparison.ERROR, Comparison.BESIDE):
            state.comparison = comparison
            if comparison is Comparison.ERROR and self._wanted(comparison.value.lower()):
                yield from self._until(lambda: session.difference.current is not None)
            yield from self._look(comparison.value.lower(), frames=8)
        state.view_mode = ViewMode.DEPTH
        yield from self._look("side by side, depth")
        state.view_mode, state.reference, state.comparison = ViewMode.COLOR, Reference.NONE, Comparison.OVER
        middle = self._window.ui.marks["picture"]
        self._window.ui.script_pointer = ((middle[2] - middle[0]) / 2, (middle[3] - middle[1]) / 2)
        yield from self._look("hover")
        self._window.ui.script_pointer = None

    def _film(self) -> Iterator[None]:
        session = self._session
        for turn in range(3):
            session.camera_path.add()
            session.navigation.look_from(orbit(session.state.viewpoint, 0.4, 0.05 * turn))
        session.camera_path.move(2, 6.5)
        session.camera_path.seek(3.0)
        session.requests.put(ShowPanel("Camera path"))
        yield from self._look("camera path", frames=8)
        self._front("Timeline")
        session.navigation.look_from_start()

    def _dialogs(self) -> Iterator[None]:
        session, ids = self._session, self._cars()
        fill_in(session, self._scene)
        for name, request in list_requests(self._scene, ids[0]).items():
            if not self._wanted(f"dialog {name}"):
                continue
            # Not by the queue: the list of instances would take the renaming.
            self._window._dialogs.open(self._window.ui, request)
            yield from self._look(f"dialog {name}", frames=25 if name == "split" else 5)
            yield from self._escape()
        for what in KINDS:
            self._window._dialogs.open(self._window.ui, AskExport(what))
            yield from self._look(f"dialog export {what}", frames=5)
            yield from self._escape()
        session.files.autosave.recoverable = []
        others = tuple(self._options.out / f"{number} {LONG_NAME}.ply" for number in range(5))
        for other in others:
            other.symlink_to(self._scene)
        session.requests.put(ReceiveDrop(others))
        yield from self._look("dialog several dropped")
        yield from self._escape()

    def _menus(self) -> Iterator[None]:
        for menu in filter(lambda name: self._wanted(f"menu {name}"), self._session.actions.menus):
            first = f"menu {self._session.actions.in_menu(menu)[0].id}"
            for _ in range(3):  # a click also closes what Escape has left half open
                yield from self._click(f"menu {menu}")
                if first in self._window.ui.marks:
                    break
            yield from self._look(f"menu {menu}")
            yield from self._escape()

    # ------------------------------------------------------------------ hands

    def _wanted(self, state: str) -> bool:
        return not self._options.only or state in self._options.only

    def _cars(self) -> tuple[int, ...]:
        document = self._session.document
        assert document is not None
        return tuple(i.id for i in document.scene.table if i.class_name == "Car") or document.find_visible_instances()

    def _front(self, panel: str) -> None:
        imgui.set_window_focus(f"###{panel}")

    def _click(self, mark: str) -> Iterator[None]:
        left, top, right, bottom = self._window.ui.marks[mark]
        io = imgui.get_io()
        io.add_mouse_pos_event((left + right) / 2, (top + bottom) / 2)
        yield from self._frames(2)
        io.add_mouse_button_event(0, True)
        yield from self._frames(2)
        io.add_mouse_button_event(0, False)
        yield from self._frames(2)

    def _escape(self) -> Iterator[None]:
        for down in (True, False):
            imgui.get_io().add_key_event(imgui.Key.escape, down)
            yield from self._frames(2)

    def _look(self, state: str, enter: Callable[[], object] = lambda: None, frames: int = 4) -> Iterator[None]:
        enter()
        if not self._wanted(state):
            return
        yield from self._frames(frames)
        for _ in range(PATIENCE_FRAMES if self._options.pictures else 0):
            if self._window.ui.view.settled:
                break
            yield
        yield from self._frames(1)
        ui, size = self._window.ui, imgui.get_io().display_size
        self.states[state] = {"size": [size.x, size.y], "marks": dict(ui.marks), "cut": sorted(ui.cut)}
        if self._options.pictures:
            yield from self._window.screenshot()
            Image.fromarray(self._window.last_screenshot).save(self._options.out / f"{state}.png")

    def _until(self, reached: Callable[[], bool]) -> Iterator[None]:
        while not reached():  # the tour as a whole has a limit of time
            yield

    @staticmethod
    def _frames(count: int) -> Iterator[None]:
        for _ in range(count):
            yield


def _is_cut_name(text: str, session: EditorSession) -> bool:
    """Whether a text is the beginning of the name or class of an instance, as it is drawn or measured where there is
    little room; no language translates those."""
    table = session.document.scene.table if session.document is not None else ()
    names = {name for entry in table for name in (entry.name, entry.class_name)}
    beginning = text.rstrip(" …")
    return bool(beginning) and text not in names and any(name.startswith(beginning) for name in names)


def main(options: Options) -> None:
    """Open the window, go on the tour, write down what was seen."""
    shutil.rmtree(options.out, ignore_errors=True)
    options.out.mkdir(parents=True)
    os.environ["INSTDRIVE_STATE"] = str(options.out / "state")
    pixels = (round(options.size[0] * options.scale), round(options.size[1] * options.scale))
    session, drawn = EditorSession(), record_texts()
    with open_virtual_display(pixels):
        window = EditorWindow(session, WindowOptions(options.size, None, False, options.scale, options.language))
        tour = Tour(window, options)
        window.run(lambda _: tour.play())
    texts = [text for text in sorted(drawn) if not _is_cut_name(text, session)]
    (options.out / "texts.json").write_text(json.dumps(texts, ensure_ascii=False), encoding="utf-8")
    (options.out / "looks.json").write_text(json.dumps(tour.states), encoding="utf-8")


if __name__ == "__main__":
    main(tyro.cli(Options))
