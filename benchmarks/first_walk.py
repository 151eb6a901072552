"""The first walk: from a first start to an exported scene without one car, counting every click and key.

`python -m benchmarks.first_walk` opens the editor's real window with fresh settings and no scene, on a virtual display,
and does with true mouse and keys what somebody does who has read nothing but the window: open the sample, close the
first steps, click a car, delete it, fill the hole, export. It prints one JSON line: the actions, what came of them, and
the seconds that they took. `--pictures FOLDER` keeps a picture of the window before each action and after the last.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import tyro
from PIL import Image

from benchmarks.monkey_hands import Hands
from benchmarks.own_state import own_state
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.shell.virtual_display import open_virtual_display
from instdrive_app.shell.window import EditorWindow
from instdrive_app.shell.window_layout import WindowOptions
from instdrive_core.edits.document.synthetic_rows import SYNTHETIC
from instdrive_core.edits.kinds.fill_hole import FillHole
from instdrive_core.formats.registry import open_scene
from instdrive_core.instances.vehicles import is_vehicle
from instdrive_core.scene.scene import Scene

SIZE = (1280, 720)
PATIENCE = 300.0
"""Seconds to wait for the window."""
GRID = 48
"""Pixels between the places of the picture at which a car is looked for, as eyes would."""


@dataclass
class Walk:
    """What was done, and what came of it."""

    actions: list[str] = field(default_factory=list)
    car: int = 0
    """Instance that was clicked."""
    exported: Path | None = None
    seconds: float = 0.0
    pictures: list[Image.Image] = field(default_factory=list)


class Walker:
    """Has hands and eyes: clicks what the window shows, and waits for what it does."""

    def __init__(self, window: EditorWindow, takes_pictures: bool) -> None:
        self._window, self._session, self._takes_pictures = window, window.session, takes_pictures
        self._hands, self.walk = Hands(), Walk()

    def play(self) -> Iterator[None]:
        """The whole walk."""
        session, started = self._session, time.monotonic()
        yield from self._click("Open the sample scene", "empty.sample")
        yield from self._until(lambda: session.document is not None and self._window.ui.view.settled, "the sample")
        yield from self._click("Got it", "first_steps.close")
        place = yield from self._find_car()
        yield from self._picture()
        yield from self._press(*place, f"Click {self._name()}")
        yield from self._until(lambda: session.selection.ids == (self.walk.car,), "the car to be selected")
        yield from self._picture()
        yield from self._key("Delete", "Press Del")
        yield from self._click("Fill hole", "deletion.fill")
        yield from self._until(self._is_filled, "the hole to be filled")
        yield from self._click("File", "menu File")
        yield from self._click("Export…", "menu file.export")
        yield from self._click("Export", "dialog.accept")
        yield from self._until(lambda: session.files.last_export is not None, "the export")
        self.walk.exported, self.walk.seconds = session.files.last_export, time.monotonic() - started
        yield from self._frames(30)
        yield from self._picture()
        session.is_quitting = True

    def close(self) -> None:
        """Let go of mouse and keys."""
        self._hands.close()

    # ------------------------------------------------------------------ hands

    def _click(self, title: str, mark: str) -> Iterator[None]:
        """Click the middle of a widget, once it is there and rests."""
        marks, seen = self._window.ui.marks, None
        while seen is None or marks.get(mark) != seen:
            yield from self._until(lambda: mark in marks, f"the widget {mark}")
            seen = marks[mark]
            yield from self._frames(3)
        yield from self._picture()
        yield from self._press((seen[0] + seen[2]) / 2, (seen[1] + seen[3]) / 2, f"Click “{title}”")

    def _press(self, x: float, y: float, title: str) -> Iterator[None]:
        self.walk.actions.append(title)
        self._hands.move(x, y)
        yield from self._frames(3)
        self._hands.press(1)
        yield from self._frames(2)
        self._hands.release(1)
        yield from self._frames(3)

    def _key(self, key: str, title: str) -> Iterator[None]:
        self.walk.actions.append(title)
        self._hands.hold(key)
        yield from self._frames(2)
        self._hands.let_go()
        yield from self._frames(2)

    # ------------------------------------------------------------------ eyes

    def _find_car(self) -> Generator[None, None, tuple[float, float]]:
        """Point here and there until the label names a car of which much is seen; returns a place in its middle."""
        left, top, right, bottom = self._window.ui.marks["picture"]
        found: dict[int, list[tuple[float, float]]] = {}
        for y in np.arange(top + 0.45 * (bottom - top), bottom - GRID, GRID):
            for x in np.arange(left + 0.3 * (right - left), right - GRID, GRID):
                self._hands.move(float(x), float(y))
                yield from self._frames(3)
                number = self._session.state.hovered
                if number and self._is_car(number):
                    found.setdefault(number, []).append((float(x), float(y)))
        car = max(found, key=lambda number: len(found[number]))
        self.walk.car = car
        return found[car][len(found[car]) // 2]

    def _is_car(self, number: int) -> bool:
        document = self._session.document
        return document is not None and is_vehicle(document.scene.table[number])

    def _name(self) -> str:
        document = self._session.document
        return "" if document is None else document.scene.table[self.walk.car].name

    def _is_filled(self) -> bool:
        document = self._session.document
        return document is not None and any(isinstance(edit, FillHole) for edit in document.history.done)

    def _picture(self) -> Iterator[None]:
        if self._takes_pictures:
            yield from self._until(lambda: self._session.document is None or self._window.ui.view.settled, "a picture")
            yield from self._window.screenshot()
            self.walk.pictures.append(Image.fromarray(self._window.last_screenshot))

    def _until(self, reached: Callable[[], bool], what: str) -> Iterator[None]:
        end = time.monotonic() + PATIENCE
        while not reached():
            if time.monotonic() > end:
                raise TimeoutError(f"waited {PATIENCE:.0f} s for {what}")
            yield

    @staticmethod
    def _frames(count: int) -> Iterator[None]:
        for _ in range(count):
            yield


def take_walk(takes_pictures: bool = False) -> tuple[Walk, Scene]:
    """Walk in a window with fresh settings; returns what was done, and the exported scene as it reads back.

    Raises TimeoutError where the window does not come to the next state, DisplayError without a display.
    """
    with own_state(), open_virtual_display(SIZE):
        session = EditorSession()
        session.state.shows_first_steps = not session.preferences.current.knows_first_steps
        window = EditorWindow(session, WindowOptions(SIZE, remember_layout=False))
        walker = Walker(window, takes_pictures)
        try:
            window.run(lambda _: walker.play())
        finally:
            walker.close()
        exported = walker.walk.exported
        if exported is None:
            raise TimeoutError("the window closed before anything was exported")
        return walker.walk, open_scene(exported)


def count_filled(scene: Scene) -> int:
    """Count the splats that files mark as synthetic."""
    return int(np.count_nonzero(scene.extra[SYNTHETIC])) if SYNTHETIC in scene.extra else 0


def main(pictures: Path | None = None) -> None:
    """Walk, and print what was done.

    Args:
        pictures: Folder for a picture of the window before each action and after the last.
    """
    walk, scene = take_walk(pictures is not None)
    if pictures is not None:
        pictures.mkdir(parents=True, exist_ok=True)
        for number, picture in enumerate(walk.pictures):
            picture.save(pictures / f"{number}.png")
    print(
        json.dumps(
            {
                "benchmark": "first_walk",
                "actions": walk.actions,
                "count": len(walk.actions),
                "seconds": round(walk.seconds, 1),
                "car": walk.car,
                "car_is_gone": walk.car not in scene.table,
                "filled_splats": count_filled(scene),
            }
        )
    )


if __name__ == "__main__":
    tyro.cli(main)
