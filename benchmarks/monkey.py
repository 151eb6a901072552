"""Random clicks, drags, keys, words and commands in the editor's real window, on a virtual display.

`python -m benchmarks.monkey --seconds 300` prints one JSON line: how much was done, and what broke: exceptions that
closed the window, failures told to the user as defects, OpenGL errors, live GL objects that grow, and invariants of
the document. At the end everything is undone, and must be bit by bit what was opened. Exits 1 where anything broke.
"""

from __future__ import annotations

import json
import random
import shutil
import sys
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from contextlib import chdir
from dataclasses import dataclass
from pathlib import Path

import tyro

from benchmarks.monkey_hands import Hands
from benchmarks.own_state import own_state
from benchmarks.sample_photos import add_photos
from instdrive_app.files.sample import find_sample_scene
from instdrive_app.messages import Level
from instdrive_app.render.gl.gl_objects import count_live_objects
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.export_kinds import KINDS, ExportChoice, What
from instdrive_app.shell.display import DisplayError
from instdrive_app.shell.virtual_display import open_virtual_display
from instdrive_app.shell.window import EditorWindow
from instdrive_app.shell.window_layout import WindowOptions
from instdrive_core.edits.document.fingerprint import fingerprint
from instdrive_core.edits.document.invariants import find_broken_invariants
from instdrive_core.evaluation.run_facts import FACTS
from instdrive_core.project.save import SUFFIX

SIZE = (1280, 720)
WORDS = ("car", "17", "road 3", "x", "0.5", "-2", "1e9", "tree")
NEVER = ("file.quit", "file.open", "file.recent", "file.sample", "file.insert")
"""Commands that would leave the document; their dialogs are reached by keys, and cancelled."""
SLOW_EXPORTS: tuple[What, ...] = ("masks", "cameras")
"""A picture for each of many photos: there would be time for little else."""
OFTEN = (
    *("panel.", "map.", "way.", "ego.", "path.", "tool.", "move.", "view.cameras", "view.all_cameras", "view.wipe"),
    *("view.flicker", "view.error", "view.beside", "file.improve", "file.record"),
)
"""Beginnings of commands that are chosen more often: what they open has actions of its own."""
PHOTOS = 8
"""Photos that the sample scene is given: wipe, flicker and heat map need some."""
DRAGGED = ("inspector.", "timeline.", "instances.", "filter.", "map.", "path.", "way.", "viewport.wipe", "views.")
"""Beginnings of the names of what is dragged: numbers, sliders, rows, the map, graphs and the line of a wipe."""
CHECK_SECONDS = 3.0
"""Between two looks at the whole document."""
NEAR = 60.0
"""Pixels of a short drag: one that ends in the panel where it began."""
SLOW = 0.15
"""Seconds from which a frame is felt as a stop."""
SLOWEST = 6
"""Frames that took the most CPU time, as many are told."""
SLACK_OBJECTS = 40
"""Live GL objects more than after the first half that count as a leak."""


@dataclass(frozen=True)
class Options:
    """Let a monkey use the editor."""

    seconds: float = 30.0
    """At most."""
    actions: int = 1_000_000
    """At most."""
    scene: Path | None = None
    """What to open; default: the sample scene. Works on a copy."""
    seed: int = 0


class Monkey:
    """Plays in a window, one action at a time."""

    def __init__(self, window: EditorWindow, options: Options) -> None:
        self._window, self._session = window, window.session
        self._random, self._seconds, self._most = random.Random(options.seed), options.seconds, options.actions
        self._hands = Hands()
        self.actions: Counter[str] = Counter()
        self.commands: Counter[str] = Counter()
        self.dragged: Counter[str] = Counter()
        self.problems: list[str] = []
        self.frames = 0
        self.longest_frame, self.longest_in = 0.0, ""
        """Seconds, and the action that was under way."""
        self.slow_frames = 0
        """Frames longer than `SLOW`."""
        self.works: list[tuple[float, str]] = []
        """Most CPU seconds of the window's thread in one frame, with the actions; they depend little on other work."""
        self._doing = ""
        self.objects: list[int] = []

    def play(self) -> Iterator[None]:
        """The whole session: wait for the scene, play, undo everything, look closely."""
        while self._session.document is None or self._session.jobs.current is not None:
            yield
        document = self._session.document
        before = fingerprint(document)
        end, next_check = time.monotonic() + self._seconds, 0.0
        while time.monotonic() < end and self.actions.total() < self._most:
            yield from self._act()
            self._session.is_quitting = False
            if self._session.document is not document:
                self.problems.append("another document was opened")
                break
            if time.monotonic() >= next_check:
                self._check()
                next_check = time.monotonic() + CHECK_SECONDS
        yield from self._calm()
        self._check()
        last = document.history.cursor
        yield from self._jump(0)
        if fingerprint(document) != before:
            self.problems.append("undoing everything does not restore what was opened")
        yield from self._jump(last)
        yield from self._jump(0)
        if fingerprint(document) != before:
            self.problems.append("redoing and undoing everything does not restore what was opened")
        yield from self._frames(3)
        self._describe()
        self._leaks()

    def _jump(self, cursor: int) -> Iterator[None]:
        self._session.history.jump(cursor)
        while self._session.history.is_jumping:
            yield

    def close(self) -> None:
        """Let go of mouse and keys."""
        self._hands.close()

    # ------------------------------------------------------------------ actions

    def _act(self) -> Iterator[None]:
        weights = {
            self._command: 6,
            self._click_widget: 6,
            self._click_picture: 5,
            self._drag: 4,
            self._key: 4,
            self._drag_widget: 3,
            self._word: 2,
            self._time: 1,
            self._save: 0.3,
            self._export: 0.3,
        }
        action = self._random.choices(list(weights), list(weights.values()))[0]
        self._doing = action.__name__.strip("_")
        self.actions[self._doing] += 1
        yield from action()

    def _command(self) -> Iterator[None]:
        document = self._session.document
        if document is not None and self._random.random() < 0.6:
            visible = document.find_visible_instances()
            count = min(len(visible), self._random.choice((1, 1, 2, 5)))
            self._session.selection.select(tuple(self._random.sample(visible, count)))
        commands = [command.id for command in self._session.actions if command.id not in NEVER]
        often = [name for name in commands if name.startswith(OFTEN)]
        chosen = self._random.choice(often if self._random.random() < 0.4 else commands)
        self._doing = f"command {chosen}"
        self.commands[chosen] += self._session.actions.run(chosen)
        yield from self._frames(2)

    def _click_widget(self) -> Iterator[None]:
        names = sorted(name for name in self._window.ui.marks if name not in ("viewport", "picture", "hover label"))
        if not names:
            return
        name = self._random.choice(names)
        left, top, right, bottom = self._window.ui.marks.get(name, (0.0, 0.0, 0.0, 0.0))
        self._doing = f"click on {name}"
        x, y = self._random.uniform(left, right), self._random.uniform(top, bottom)
        yield from self._click_somewhere(x, y, self._random.choices((1, 3), (6, 1))[0])

    def _click_picture(self) -> Iterator[None]:
        yield from self._click_somewhere(*self._place(), self._random.choices((1, 3), (5, 1))[0])

    def _click_somewhere(self, x: float, y: float, button: int) -> Iterator[None]:
        for key in ("shift", "ctrl", "alt"):
            if self._random.random() < 0.12:
                self._hands.hold(key)
        self._hands.move(x, y)
        yield from self._frames(2)
        for _ in range(self._random.choices((1, 2), (8, 1))[0]):
            self._hands.press(button)
            yield from self._frames(1)
            self._hands.release(button)
            yield from self._frames(1)
        self._hands.let_go()

    def _drag(self) -> Iterator[None]:
        yield from self._drag_somewhere(*self._place(), self._random.choices((1, 2, 3), (4, 1, 1))[0])

    def _drag_widget(self) -> Iterator[None]:
        """From a handle, where there are any, else from a number, a slider, a graph or a row; half the time nearby."""
        marks = self._window.ui.marks
        handles = sorted(name for name in marks if name.startswith("gizmo."))
        others = sorted(name for name in marks if name.startswith(DRAGGED))
        names = handles if handles and (not others or self._random.random() < 0.6) else others
        if names:
            name = self._random.choice(names)
            self._doing = f"drag of {name}"
            self.dragged[name.rpartition(".")[0] or name] += 1
            left, top, right, bottom = marks[name]
            is_near = self._random.random() < 0.5
            yield from self._drag_somewhere((left + right) / 2, (top + bottom) / 2, 1, NEAR if is_near else None)

    def _drag_somewhere(self, x: float, y: float, button: int, near: float | None = None) -> Iterator[None]:
        self._hands.move(x, y)
        yield from self._frames(2)
        self._hands.press(button)
        for _ in range(self._random.randrange(2, 7)):
            if near is None:
                self._hands.move(*self._place())
            else:
                self._hands.move(x + self._random.uniform(-near, near), y + self._random.uniform(-near, near))
            yield from self._frames(1)
        self._hands.release(button)
        yield from self._frames(1)

    def _key(self) -> Iterator[None]:
        chords = [shortcut for command in self._session.actions for shortcut in command.shortcuts]
        chord = self._random.choice([*chords, "Escape", "Return", "Tab", "w", "a", "s", "d"])
        if chord in ("Ctrl+Q", "Ctrl+O"):
            return
        self._doing = f"key {chord}"
        names = {"LeftArrow": "Left", "RightArrow": "Right", "=": "equal", "-": "minus"}
        *modifiers, key = chord.split("+")
        for modifier in modifiers:
            self._hands.hold(modifier.lower())
        self._hands.hold(names.get(key, key.lower() if len(key) == 1 else key))
        yield from self._frames(self._random.randrange(1, 4))
        self._hands.let_go()
        yield from self._frames(1)

    def _word(self) -> Iterator[None]:
        self._hands.type(self._random.choice(WORDS))
        yield from self._frames(2)

    def _time(self) -> Iterator[None]:
        steps = self._session.navigation.timeline.steps
        if steps:
            self._session.navigation.set_time(self._random.choice(steps))
        yield from self._frames(2)

    def _save(self) -> Iterator[None]:
        self._session.files.save(Path(f"saved{SUFFIX}").resolve())
        yield from self._frames(2)

    def _export(self) -> Iterator[None]:
        """Whatever there is to be exported, each time over what was exported before."""
        quick: list[What] = [what for what in KINDS if what not in SLOW_EXPORTS]
        what = self._random.choice(quick)
        ending = (KINDS[what].endings or ("",))[0]
        self._session.export.write(Path(f"exported_{what}{ending}").resolve(), ExportChoice(what))
        yield from self._frames(2)

    def _place(self) -> tuple[float, float]:
        left, top, right, bottom = self._window.ui.marks.get("picture", (0.0, 0.0, *map(float, SIZE)))
        return self._random.uniform(left, right), self._random.uniform(top, bottom)

    def _frames(self, count: int) -> Iterator[None]:
        for _ in range(count):
            started, worked = time.perf_counter(), time.thread_time()
            yield
            lasted = time.perf_counter() - started
            self.works = sorted([*self.works, (time.thread_time() - worked, self._doing)])[-SLOWEST:]
            self.slow_frames += lasted > SLOW
            if lasted > self.longest_frame:
                self.longest_frame, self.longest_in = lasted, self._doing
            self.frames += 1

    def _calm(self) -> Iterator[None]:
        """Nothing held, nothing open, nothing under way."""
        self._hands.let_go()
        self._session.navigation.playing = False
        for _ in range(4):
            self._hands.hold("Escape")
            yield from self._frames(2)
            self._hands.let_go()
            yield from self._frames(2)
        while self._session.jobs.current is not None:
            yield from self._frames(1)

    # ------------------------------------------------------------------ checks

    def _check(self) -> None:
        document = self._session.document
        if document is not None and not self._session.jobs.is_blocking:
            self.problems += find_broken_invariants(document)
        self.objects.append(sum(count_live_objects().values()))
        fault = self._window.ui.view.gl_error
        if fault is not None:
            self.problems.append(f"OpenGL reports {fault}")

    def _describe(self) -> None:
        errors = [message.text for message in self._session.messages.log if message.level is Level.ERROR]
        self.problems += [text for text in errors if "report" in text]

    def _leaks(self) -> None:
        half = self.objects[: len(self.objects) // 2 + 1]
        if self.objects[-1] > max(half) + SLACK_OBJECTS:
            self.problems.append(f"live GL objects grew from {max(half)} to {self.objects[-1]}")


def play(options: Options) -> dict[str, object]:
    """Run the monkey; returns what the JSON line says."""
    source, failure = options.scene or find_sample_scene(), None
    with own_state() as folder, chdir(folder), open_virtual_display(SIZE):
        scene = folder / source.name
        (shutil.copytree if source.is_dir() else shutil.copy)(source, scene)
        if options.scene is None:
            add_photos(scene, PHOTOS)
            (scene / FACTS).write_text(json.dumps({"clip": str(folder / "gone")}), encoding="utf-8")
        session = EditorSession()
        session.files.open(scene)
        window = EditorWindow(session, WindowOptions(SIZE, remember_layout=False))
        monkey = Monkey(window, options)
        try:
            window.run(lambda _: monkey.play())
        except DisplayError:
            raise
        except Exception as error:  # whatever it is, it is what the monkey is for
            failure = error
        finally:
            monkey.close()
    problems = list(monkey.problems)
    if failure is not None:
        problems.append("the window closed with " + "".join(traceback.format_exception(failure)))
    return {
        "seed": options.seed,
        "seconds": options.seconds,
        "frames": monkey.frames,
        "actions": sum(monkey.actions.values()),
        "edits": len(session.document.history.edits) if session.document else 0,
        "commands": len(+monkey.commands),
        "dragged": dict(monkey.dragged.most_common()),
        "longest_frame_ms": round(1e3 * monkey.longest_frame),
        "frames_above_150_ms": monkey.slow_frames,
        "most_cpu_ms": [[round(1e3 * seconds), doing] for seconds, doing in reversed(monkey.works)],
        "longest_in": monkey.longest_in,
        "gl_objects": [monkey.objects[0], monkey.objects[-1]] if monkey.objects else [],
        "problems": problems,
    }


def main() -> None:
    """Print the JSON line."""
    result = play(tyro.cli(Options))
    print(json.dumps(result))
    sys.exit(bool(result["problems"]))


if __name__ == "__main__":
    main()
