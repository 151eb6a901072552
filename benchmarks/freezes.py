"""How long the editor's window stands still for what is done to everything at once.

`python -m benchmarks.freezes` opens the real window, on a virtual display where there is no other, on a million splats
in some 5,000 instances, plays each step of `freeze_steps`, and prints one JSON line: name → longest frame in
milliseconds, from the step until the picture is sharp and no work is under way; each is told on stderr when it is
known. Undo and redo of it are told as
``NAME, undo`` and ``NAME, redo``. `--only WORD …` plays the steps that have one of the words in their names.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

import tyro

from benchmarks.editor_scene import BLOCK, SIZE, write_street
from benchmarks.freeze_steps import STEPS, Act, Desk, Step, frames
from benchmarks.monkey_hands import Hands
from benchmarks.own_state import own_state
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.shell.display import has_display
from instdrive_app.shell.virtual_display import open_virtual_display
from instdrive_app.shell.window import EditorWindow
from instdrive_app.shell.window_layout import WindowOptions
from instdrive_core.errors import InstDriveError

PATIENCE_FRAMES = 5_000
INSERTED = 100_000
"""Splats of the scene that is inserted."""


@dataclass(frozen=True)
class Options:
    """Look for freezes."""

    splats: int = 1_000_000
    block: float = 0.25
    """Side of an instance over a car's: 1 makes some 360 instances, 0.25 some 5,300."""
    only: tuple[str, ...] = ()
    """Words, one of which the names of the steps to be played hold; none = all of them."""
    above: float = 0.0
    """Tell only what takes longer than so many milliseconds."""
    cpu: bool = False
    """Also tell the CPU time that the UI's thread has spent on one frame at most, as ``NAME, cpu``."""


class Observer:
    """Plays steps in a window, with a clock beside every frame."""

    def __init__(self, window: EditorWindow, folder: Path, steps: tuple[Step, ...]) -> None:
        self._desk, self._steps = Desk(window, Hands(), folder), steps
        self.longest: dict[str, float] = {}
        """Seconds by the names of steps."""
        self.busiest: dict[str, float] = {}
        """Most seconds of CPU that the UI's thread has spent on one frame: hardly depends on what else runs."""
        self.took: dict[str, float] = {}
        """Seconds until all is done."""

    def play(self) -> Iterator[None]:
        """All steps, each from the scene as it was opened."""
        session = self._desk.session
        yield from self._measure("open", self._wait_until_open())
        session.navigation.look_from(session.state.viewpoint)
        for step in self._steps:
            for act in step.before:
                yield from self._wait_until_done(act)
            cursor = self._desk.document.history.cursor
            yield from self._measure(step.name, self._wait_until_done(step.act))
            if step.edits and self._desk.document.history.cursor == cursor:
                print(f"{step.name} was refused: {self._describe()}", file=sys.stderr, flush=True)
            elif step.edits:
                yield from self._measure(
                    f"{step.name}, undo", self._wait_until_done(lambda desk: desk.session.history.undo())
                )
                yield from self._measure(
                    f"{step.name}, redo", self._wait_until_done(lambda desk: desk.session.history.redo())
                )
            yield from self._wait_until_done(lambda desk: desk.session.history.jump(0))

    def close(self) -> None:
        """Let go of mouse and keys."""
        self._desk.hands.close()

    def _measure(self, name: str, steps: Iterator[None]) -> Iterator[None]:
        began, longest, busiest = time.perf_counter(), 0.0, 0.0
        started, worked = began, time.thread_time()
        for _ in steps:
            yield
            now, spent = time.perf_counter(), time.thread_time()
            longest, busiest = max(longest, now - started), max(busiest, spent - worked)
            started, worked = now, spent
        self.longest[name], self.took[name] = longest, time.perf_counter() - began
        self.busiest[name] = busiest
        told = f"{1e3 * longest:8.1f} ms, {1e3 * busiest:6.1f} of CPU; done after {self.took[name]:5.2f} s: {name}"
        print(told, file=sys.stderr, flush=True)

    def _wait_until_open(self) -> Iterator[None]:
        while self._desk.session.document is None:
            yield
        yield from self._calm()

    def _wait_until_done(self, act: Act) -> Iterator[None]:
        going_on = act(self._desk)
        if going_on is not None:
            yield from going_on
        yield from self._calm()

    def _calm(self) -> Iterator[None]:
        """Until nothing is under way, and a few frames more."""
        session, window = self._desk.session, self._desk.window
        yield from frames(2)
        for _ in range(PATIENCE_FRAMES):
            if session.jobs.current is None and not session.history.is_jumping and window.ui.view.settled:
                break
            yield
        yield from frames(3)

    def _describe(self) -> str:
        log = self._desk.session.messages.log
        return log[-1].text if log else "nothing was told"


def main(options: Options) -> dict[str, float]:
    """Everything the JSON line says."""
    chosen = tuple(step for step in STEPS if not options.only or any(word in step.name for word in options.only))
    with own_state() as folder, nullcontext() if has_display() else open_virtual_display(SIZE):
        write_street(folder, INSERTED)[0].rename(folder / "inserted.ply")
        path, _ = write_street(folder, options.splats, options.block * BLOCK)
        session = EditorSession()
        window = EditorWindow(session, WindowOptions(SIZE, remember_layout=False))
        session.files.open(path)
        observer: list[Observer] = []

        def play(running: EditorWindow) -> Iterator[None]:
            observer.append(Observer(running, folder, chosen))
            yield from observer[0].play()

        try:
            window.run(play)
        finally:
            for each in observer:
                each.close()
    told = {name: round(1e3 * seconds, 1) for name, seconds in observer[0].longest.items()}
    spent = {f"{name}, cpu": round(1e3 * seconds, 1) for name, seconds in observer[0].busiest.items()}
    return {name: ms for name, ms in told.items() if ms >= options.above} | (spent if options.cpu else {})


if __name__ == "__main__":
    try:
        print(json.dumps(main(tyro.cli(Options))))
    except InstDriveError as error:
        print(error, file=sys.stderr)
        raise SystemExit(2) from None
