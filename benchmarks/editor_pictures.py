"""Pictures of the editor at work, for docs/: `python -m benchmarks.editor_pictures RUN`.

Opens the real window on a run, on a virtual display where there is none, and takes a picture of it in each of several
states: moving by handles, the report after a deletion, a lasso, labels, the photo beside the splats, the palette.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from PIL import Image
from tyro.conf import Positional, arg

from benchmarks.own_state import own_state
from benchmarks.picture_layout import beside, save_jpeg
from instdrive_app.demo.showpiece import choose_showpiece_view, rank_objects
from instdrive_app.render.frame_renderer import FrameRenderer
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.requests import ShowPalette
from instdrive_app.shell.display import has_display
from instdrive_app.shell.virtual_display import open_virtual_display
from instdrive_app.shell.window import EditorWindow
from instdrive_app.shell.window_layout import WindowOptions
from instdrive_app.state import Comparison, Reference, ViewMode, resolve

SIZE = (1280, 720)
MAX_BYTES = 900_000
LONGEST = 20_000
"""Frames to wait for something."""


class Tour:
    """Brings the editor into one state after the other."""

    def __init__(self, window: EditorWindow) -> None:
        self._window, self._session = window, window.session
        self.pictures: dict[str, Image.Image] = {}

    def play(self) -> Iterator[None]:
        """All states."""
        session = self._session
        while session.document is None:
            yield
        yield from self._calm()
        self._window.ui.script_pointer = (-1.0, -1.0)  # wherever the mouse is, nothing is pointed at
        session.navigation.look_through(choose_showpiece_view(self._renderer, session))
        yield from self._calm()
        first, second = self._things()
        for name, state in (
            ("move", self._moving(second)),
            ("deletion", self._deleting(first)),
            ("colours", self._recoloring(second)),
            ("instances", self._showing_instances(second)),
            ("photo", self._comparing()),
            ("palette", self._finding()),
        ):
            yield from state
            session.messages.dismiss()
            yield from self._calm()
            yield from self._window.screenshot()
            self.pictures[name] = Image.fromarray(self._window.last_screenshot)

    def _moving(self, instance: int) -> Iterator[None]:
        self._session.selection.select((instance,))
        self._session.state.tool = "move"
        self._session.movement.options.along_lane = True
        yield from self._calm()

    def _deleting(self, instance: int) -> Iterator[None]:
        self._session.state.tool = "pick"
        self._session.deletion.delete((instance,))
        yield from self._until(lambda: self._session.deletion.review.findings is not None)

    def _recoloring(self, instance: int) -> Iterator[None]:
        session = self._session
        session.deletion.review.absorb()
        session.deletion.review.fill()
        yield from self._until(lambda: not session.deletion.review.is_filling and session.jobs.current is None)
        session.selection.select((instance,))
        session.colors.recolor((instance,), "tint", (0.16, 0.42, 0.75))
        yield from self._calm()

    def _showing_instances(self, instance: int) -> Iterator[None]:
        self._session.state.view_mode = ViewMode.INSTANCE
        self._session.state.tool = "lasso"
        yield from self._calm()

    def _comparing(self) -> Iterator[None]:
        state = self._session.state
        state.view_mode, state.tool = ViewMode.COLOR, "pick"
        state.reference, state.comparison = Reference.PHOTO, Comparison.BESIDE
        yield from self._until(lambda: not self._session.references.is_reading)

    def _finding(self) -> Iterator[None]:
        self._session.state.reference = Reference.NONE
        self._session.requests.put(ShowPalette())
        yield from self._calm()

    # ------------------------------------------------------------------ waiting

    @property
    def _renderer(self) -> FrameRenderer:
        return self._window.ui.view.renderer

    def _things(self) -> tuple[int, int]:
        document = self._session.document
        assert document is not None
        lens = self._session.state.viewpoint.lens
        ids = self._renderer.read_instance_ids(resolve(self._session.state, 480, round(480 * lens.height / lens.width)))
        first, second, *_ = rank_objects(document.scene, np.asarray(ids))
        return first, second

    def _until(self, reached: Callable[[], bool]) -> Iterator[None]:
        for _ in range(LONGEST):
            yield
            if reached():
                return
        raise TimeoutError("the editor does not come to the next state")

    def _calm(self) -> Iterator[None]:
        for _ in range(12):
            yield
        yield from self._until(lambda: self._window.ui.view.settled)


def main(
    run: Positional[Path] = Path("runs/demo/run"), out: Annotated[Path, arg(aliases=["-o"])] = Path("docs/images")
) -> None:
    """Take the pictures.

    Args:
        run: Folder of a finished run whose clip is still there.
        out: Folder of the pictures.
    """
    run = run.absolute()
    with own_state(), nullcontext() if has_display() else open_virtual_display(SIZE):
        session = EditorSession()
        session.files.open(run)
        window = EditorWindow(session, WindowOptions(SIZE, remember_layout=False))
        tour = Tour(window)
        window.run(lambda _: tour.play())
    pictures = [np.asarray(picture) for picture in tour.pictures.values()]
    rows = [beside(pictures[start : start + 2]) for start in range(0, len(pictures), 2)]
    target = out / "editor_tour.jpg"
    save_jpeg(np.concatenate(rows), target, MAX_BYTES)
    print(json.dumps({"picture": str(target), "states": list(tour.pictures)}))


if __name__ == "__main__":
    tyro.cli(main)
