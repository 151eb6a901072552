"""Drives the editor's real window with true mouse and key events, and reads what the window reports."""

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from clipboard import copied
from seed import SeededProcess

from instdrive_app.shell.virtual_display import open_virtual_display
from instdrive_core.files.file_lock import FileLock
from instdrive_core.scene.camera import Camera

PATIENCE = 240.0
"""Seconds to wait for the window to come to a state, on a busy machine. Waiting costs nothing where all is well."""
KERNELS = """
from instdrive_app.render.software.warm_up import warm_up_software
from instdrive_app.render.warm_up import warm_up
warm_up()
warm_up_software()
"""
NO_KEY = "Pause"
"""Means nothing to the editor, and wakes it where it is idle: then it draws but once a second."""
ANSWERED = ("getdisplaygeometry",)
"""An xdotool command that waits for an answer of the display, hence for all that was asked of it before, and needs no
window, which may just have closed."""
DOUBLE_CLICK = 0.5
"""Seconds after which a second click at the same place is a click of its own."""


@contextmanager
def editor_display(size=(1280, 720)):
    """A display with hands; tests that need it are skipped, and say so, where there is none."""
    for tool in ("Xvfb", "xdotool"):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not installed")
    compile_kernels()
    with open_virtual_display(size):
        yield


@cache
def compile_kernels():
    """What an editor compiles as it starts, so that no test waits for it: half a minute of a core in a fresh clone.

    One at a time, as tests' workers begin together: the second finds compiled what the first needed.
    """
    path = Path(tempfile.gettempdir(), f"instdrive-tests-{os.getuid()}.lock")
    while (lock := FileLock.acquire(path)) is None:
        time.sleep(0.05)
    try:
        subprocess.run([sys.executable, "-c", KERNELS], check=True)
    finally:
        lock.release()


@contextmanager
def editor_window(scene, folder, opens=True, **options):
    """An editor on a display of its own, until the block ends; `opens`: wait until the scene is there and calm."""
    with editor_display(options.get("size", (1280, 720))):
        driver = WindowDriver(scene, folder, **options)
        try:
            if opens:
                driver.wait_until_open()
            yield driver
        finally:
            driver.close()


def start_editor(scene, folder, name):
    """An editor on the present display that shares what editors remember with the others of a test's folder."""
    (folder / name).mkdir()
    driver = WindowDriver(scene, folder / name, state=folder / "state")
    try:
        driver.wait_until_open()
    except BaseException:
        driver.close()
        raise
    return driver


class WindowDriver:
    """One running editor on the present display."""

    def __init__(self, scene, folder, size=(1280, 720), state=None, knows_first_steps=True, density=1, program=None):
        """`density`: 2 for a display with two pixels of the screen for one of the window, in which all places are.

        `program`: name of a script beside this one that starts the editor in its own way.
        """
        self._report = folder / "report.jsonl"
        self._errors = (folder / "stderr.txt").open("w+")
        self._density = density
        program = "dense_editor.py" if density > 1 else program or "plain_editor.py"
        arguments = ["edit", scene, "--report", self._report, "--size", *size, "--no-remember-layout"]
        # Its own, unless another driver's is given: what that one left is offered to this one.
        chosen = (state or folder / "state") / "preferences.json"
        if knows_first_steps and not chosen.exists():  # else they would lie over the picture
            chosen.parent.mkdir(parents=True, exist_ok=True)
            chosen.write_text(json.dumps({"knows_first_steps": True}))
        environment = {**os.environ, "INSTDRIVE_STATE": str(state or folder / "state")}
        self._process = SeededProcess(Path(__file__).with_name(program), arguments, environment, self._errors)
        self._clicked = (0.0, 0.0, 0.0)

    @property
    def state(self):
        """The last complete line of the report."""
        if self._process.poll() is not None:
            self._errors.seek(0)
            raise AssertionError(f"the editor ended with status {self._process.returncode}:\n{self._errors.read()}")
        if not self._report.exists():
            return {"open": False, "widgets": {}}
        lines = self._report.read_text(encoding="utf-8").rsplit("\n", 2)
        return json.loads(lines[-2]) if len(lines) > 1 else {"open": False, "widgets": {}}

    def states(self):
        """Everything reported so far, in order."""
        lines = self._report.read_text(encoding="utf-8").rsplit("\n", 1)[0].splitlines()
        return [json.loads(line) for line in lines]

    def wait_for(self, wanted, what, patience=PATIENCE):
        """The first state for which `wanted(state)` holds; fails with `what` and the last state."""
        end = time.monotonic() + patience
        while time.monotonic() < end:
            state = self.state
            if wanted(state):
                return state
            time.sleep(0.05)
        shown = {key: value for key, value in state.items() if key != "camera"} | {"widgets": sorted(state["widgets"])}
        raise AssertionError(
            f"waited {patience:.0f} s for: {what}. The window reports {shown}; its threads were at\n{self._stacks()}"
        )

    def wait_for_frames(self, count=2):
        """Until the window has drawn so often since now, or has ended; with two it has heard of what was done before.

        However slow the machine is: what lasts over some frames is seen, and what has not changed over some is at rest.
        """
        start, drawn, nudged = time.monotonic(), self._drawn_at(), False
        while count > 0 and self._process.poll() is None:
            now = self._drawn_at()
            waited = time.monotonic() - start
            if now != drawn:
                drawn, count = now, count - 1
            elif not nudged and waited > 0.06:
                self._xdotool("key", NO_KEY)
                nudged = True
            elif waited > PATIENCE:
                raise AssertionError(f"no frame in {PATIENCE:.0f} s; the window's threads were at\n{self._stacks()}")
            else:
                time.sleep(0.004)

    def _drawn_at(self):
        """Changes with every frame: the report is touched by each."""
        return self._report.stat().st_mtime_ns if self._report.exists() else 0

    def _stacks(self):
        """Where all threads of the editor are; this ends it."""
        self._process.send_signal(signal.SIGABRT)
        self._process.wait(PATIENCE)
        self._errors.seek(0)
        return self._errors.read()

    def wait_until_open(self):
        """The state, once the scene is open, sharp and calm."""
        self.wait_for(lambda state: state["open"] and state["settled"], "the scene to be open")
        return self.wait_until_calm()

    def wait_for_selection(self, *ids):
        """The state, once just these instances are selected."""
        return self.wait_for(lambda state: state["selected"] == list(ids), f"instances {ids} to be selected")

    def wait_for_edit(self, beginning):
        """The state, once an edit whose title begins so is the history's last, and done."""

        def is_last(state):
            return state["cursor"] == len(state["history"]) > 0 and state["history"][-1].startswith(beginning)

        return self.wait_for(is_last, beginning)

    def wait_for_message(self, text):
        """The state, once some message holds this text."""
        return self.wait_for(lambda state: any(text in message for message in state.get("messages", ())), text)

    def wait_until_calm(self, seconds=0.4):
        """The state, once it has not changed for a while and some frames: panels have found their places."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            state, still_until = self.state, time.monotonic() + seconds
            self.wait_for_frames(3)
            while self.state == state:
                if time.monotonic() > still_until:
                    return state
                time.sleep(0.05)
        raise AssertionError(f"the window does not come to rest; its threads were at\n{self._stacks()}")

    def wait_for_widget(self, name):
        """The middle of a widget, once it is drawn and has not moved for a moment."""
        left, top, right, bottom = self.wait_for_rect(name)
        return (left + right) / 2, (top + bottom) / 2

    def wait_for_rect(self, name):
        """Left, top, right, bottom of a widget, once it is drawn and has not moved for a moment."""
        self.wait_for(lambda state: name in state["widgets"], f"the widget {name!r}")
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            rect = self.state["widgets"].get(name)
            self.wait_for_frames()
            if rect is not None and rect == self.state["widgets"].get(name):
                return rect
        raise AssertionError(f"the widget {name!r} does not stay; there are {sorted(self.state['widgets'])}")

    def pixel_of(self, point):
        """Where a world point is in the window."""
        x, y = self.pixels_of([point])[0]
        return x, y

    def pixels_of(self, points):
        """Where world points are in the window: (n, 2)."""
        state = self.wait_until_calm()
        left, top, right, _ = state["widgets"]["picture"]
        lens = state["camera"]
        pose = np.array(lens["world_from_camera"])
        camera = Camera(*(float(lens[name]) for name in ("fx", "fy", "cx", "cy")), lens["width"], lens["height"], pose)
        return camera.project(np.array(points, float))[0] * (right - left) / camera.width + [left, top]

    def move(self, x, y):
        """Move the mouse; a second, tiny move makes sure that the window hears of it."""
        x, y = round(x * self._density), round(y * self._density)
        self._xdotool("mousemove", x - 1, y, "mousemove", x, y)

    def click(self, x, y, *modifiers, button=1):
        """Press and release, with modifier keys held; both last over some frames."""
        last_x, last_y, when = self._clicked
        if abs(x - last_x) + abs(y - last_y) < 20:
            time.sleep(max(0.0, when + DOUBLE_CLICK - time.monotonic()))
        self.move(x, y)
        for modifier in modifiers:
            self._xdotool("keydown", modifier)
        self.wait_for_frames()
        self._xdotool("mousedown", button)
        self.wait_for_frames()
        self._xdotool("mouseup", button)
        self._clicked = (x, y, time.monotonic())
        self.wait_for_frames()
        for modifier in modifiers:
            self._xdotool("keyup", modifier)

    def double_click(self, x, y):
        """Press and release twice, as fast as the window takes it."""
        self.move(x, y)
        self.wait_for_frames()
        self._xdotool(*("mousedown", 1, "mouseup", 1) * 2)
        self._clicked = (x, y, time.monotonic())
        self.wait_for_frames(4)

    def wheel(self, x, y, notches, *modifiers):
        """Turn the wheel at a place, up by so many notches (negative: down), with modifier keys held."""
        self.move(x, y)
        for modifier in modifiers:
            self._xdotool("keydown", modifier)
        self.wait_for_frames()
        for _ in range(abs(notches)):
            self._xdotool("click", 4 if notches > 0 else 5)
            self.wait_for_frames()
        for modifier in modifiers:
            self._xdotool("keyup", modifier)

    def click_widget(self, name, *modifiers, button=1):
        """Click the middle of a widget, once it takes clicks: what it needs may still be computed."""

        def takes_clicks(state):
            return name in state["widgets"] and name not in state["disabled"]

        self.wait_for(takes_clicks, f"the widget {name!r} to take clicks")
        self.click(*self.wait_for_widget(name), *modifiers, button=button)

    def click_grey(self, name):
        """Click the middle of a widget that takes no clicks."""
        place = self.wait_for_widget(name)
        assert name in self.state["disabled"], f"the widget {name!r} takes clicks"
        self.click(*place)

    def drag(self, start, end, button=1, steps=8, modifiers=(), before_release=lambda: None):
        """Press at `start`, move to `end`, release; with modifier keys held."""
        path = [tuple(np.array(start) + (np.array(end) - start) * part) for part in np.linspace(0, 1, steps + 1)]
        self.drag_along(path, button, modifiers, before_release)

    def drag_along(self, path, button=1, modifiers=(), before_release=lambda: None):
        """Press at the first point of `path`, move along the others, do `before_release`, release."""
        self.move(*path[0])
        for modifier in modifiers:
            self._xdotool("keydown", modifier)
        self.wait_for_frames()
        self._xdotool("mousedown", button)
        for x, y in path[1:]:
            self.wait_for_frames()
            self._xdotool("mousemove", round(x * self._density), round(y * self._density))
        self.wait_for_frames()
        before_release()
        self._xdotool("mouseup", button)
        self.wait_for_frames()
        for modifier in modifiers:
            self._xdotool("keyup", modifier)

    def key(self, name):
        """Press a key or a chord such as ``ctrl+z``."""
        *modifiers, key = name.split("+")
        for modifier in modifiers:
            self._xdotool("keydown", modifier)
        self._xdotool("keydown", key)
        self.wait_for_frames()
        self._xdotool("keyup", key)
        for modifier in modifiers:
            self._xdotool("keyup", modifier)

    def tap(self, name):
        """Press a key, with modifiers held, so shortly that it does not repeat, however long frames last."""
        *modifiers, key = name.split("+")
        for modifier in modifiers:
            self._xdotool("keydown", modifier)
        if modifiers:
            self.wait_for_frames()
        self._xdotool("key", key)
        self.wait_for_frames(3)  # one hears of the press, one of the release
        for modifier in modifiers:
            self._xdotool("keyup", modifier)
        if modifiers:
            self.wait_for_frames()

    def type(self, text):
        """Type text into what has the keyboard."""
        subprocess.run(["xdotool", "type", "--delay", "15", "--", text], check=True, capture_output=True)
        self._xdotool()
        self.wait_for_frames()

    def paste(self, text):
        """Put text from the clipboard into what has the keyboard: a long path, which takes a frame a letter to type."""
        with copied(text) as pasted:
            self.tap("ctrl+v")
            assert pasted.wait(PATIENCE), "nothing was pasted"
        self.wait_for_frames()

    def enter_path(self, path):
        """Put a path into the file dialog that is about to open, and accept it."""
        self.wait_for_widget("dialog.path")
        self.key("ctrl+a")
        self.paste(str(path))
        self.click_widget("dialog.accept")

    def export(self, path):
        """Export the whole scene to a path, and wait until that is told."""
        self.key("ctrl+e")
        self.enter_path(path)
        self.wait_for_message(str(path))

    def quit(self):
        """Ctrl+Q, without saving where that is asked; returns the exit status."""
        self.key("ctrl+q")
        end, asked = time.monotonic() + PATIENCE, False
        while self._process.poll() is None and time.monotonic() < end:
            if not asked and "question.Don't save" in self._last_widgets():
                asked = True  # the last report names the button also after it was clicked
                self.click_widget("question.Don't save")
            time.sleep(0.1)
        return self._process.wait(PATIENCE)

    def _last_widgets(self):
        lines = self._report.read_text(encoding="utf-8").rsplit("\n", 2)
        return json.loads(lines[-2])["widgets"] if len(lines) > 1 else {}

    @contextmanager
    def stalled(self):
        """The editor hears of what is done in the block at once, after it."""
        self._process.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            self._process.send_signal(signal.SIGCONT)
        self.wait_for_frames(4)

    def hasty_click(self, x, y):
        """Come, press and release without waiting for the window in between."""
        self.move(x, y)
        self._xdotool("mousedown", 1, "mouseup", 1)

    def hasty_drag(self, start, end):
        """Come and press in one frame of the window, then drag to `end` and release."""
        with self.stalled():
            self.move(*start)
            self._xdotool("mousedown", 1)
        self.move(*end)
        self.wait_for_frames()
        self._xdotool("mouseup", 1)
        self.wait_for_frames()

    def wait_for_end(self):
        """The exit status, once the editor has ended by itself."""
        return self._process.wait(PATIENCE)

    def kill(self):
        """End the editor as a crash would."""
        self._process.kill()
        self._process.wait(PATIENCE)

    def close(self):
        """End the editor if it still runs."""
        if self._process.poll() is None:
            self._process.terminate()
            self._process.wait(PATIENCE)
        self._errors.close()

    @staticmethod
    def _xdotool(*words):
        """One or more of its commands; at the end the display has passed on all that they do."""
        subprocess.run(["xdotool", *map(str, words), *ANSWERED], check=True, capture_output=True)
