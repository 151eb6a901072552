"""The editor's own session and view, off screen, driven as a window drives them, with a clock beside each frame."""

from __future__ import annotations

import math
import statistics
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import moderngl
import numpy as np
from PIL import Image

from instdrive_app import camera
from instdrive_app.pointer import Click
from instdrive_app.render.live_view import LiveView
from instdrive_app.render.warm_up import warm_up
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.state import Intrinsics, Viewpoint, resolve
from instdrive_app.tools.pick import PickTool
from instdrive_app.tools.registry import create_tools
from instdrive_core.evaluation.metrics.image_metrics import psnr
from instdrive_core.scene.camera import Camera

PATIENCE = 120.0
DRAFT_TURNS = (-0.2, -0.1, 0.0, 0.1, 0.2)
"""Radians, as far as the camera turns in `fps_moving`."""
FRAME = 1 / 60
"""Seconds from frame to frame while nothing hinders."""


class DrivenEditor:
    """A session and its view. Everything that the UI's thread does goes through `frame`, whose longest is kept."""

    def __init__(self, context: moderngl.Context, size: tuple[int, int]) -> None:
        self._woken = threading.Event()
        self.session, self.view = EditorSession(), LiveView(context, self._woken.set)
        self.sketch_view = LiveView(context, self._woken.set, warms_up=False)
        self.session.wake_window = self._woken.set
        self.tool, self.size = PickTool(self.session), size
        self.longest_freeze = 0.0
        """Longest frame, in seconds."""
        warm_up()  # as the window does beside its start

    def frame(self, act: Callable[[], object] = lambda: None) -> float:
        """One frame of the UI's thread that does `act`; returns its seconds."""
        started = time.perf_counter()
        act()
        self.session.tick(FRAME)
        sketch = self.session.sketches.shown
        if sketch is not None:
            self.sketch_view.show(sketch.document, self.session.state, *self.size)
        elif self.session.document is not None:
            self.sketch_view.release()
            self.view.show(self.session.document, self.session.state, *self.size)
        seconds = time.perf_counter() - started
        self.longest_freeze = max(self.longest_freeze, seconds)
        return seconds

    def frames_until(self, reached: Callable[[], bool]) -> float:
        """Frames at the window's pace until something is so; returns the seconds it took."""
        started = time.perf_counter()
        while not reached():
            if time.perf_counter() - started > PATIENCE:
                raise TimeoutError(f"nothing came in {PATIENCE:.0f} s; log: {self.session.messages.log[-1:]}")
            self.frame()
            self._woken.wait(FRAME)
            self._woken.clear()
        return time.perf_counter() - started

    def settle(self) -> None:
        """Until the picture is sharp."""
        self.frame()
        self.frames_until(lambda: self.view.settled)

    # ------------------------------------------------------------------ measurements

    def open(self, path: Path) -> float:
        """Seconds until the scene is the open document."""
        self.session.files.open(path)
        return self.frames_until(lambda: self.session.document is not None)

    def open_sketched(self, path: Path) -> tuple[float, float]:
        """Seconds until the sketch of a large scene is on the screen, and until the scene is the open document."""
        self.session.files.open(path)
        first = self.frames_until(lambda: self.sketch_view.snapshot is not None)
        return first, first + self.frames_until(lambda: self.session.document is not None)

    def export(self, path: Path) -> float:
        """Seconds until the file is whole."""
        self.session.export.write(path)
        return self.frames_until(lambda: self.session.files.last_export == path)

    def look_from(self, pose: Camera) -> None:
        """Look through a camera."""
        self.session.navigation.look_from(Viewpoint(pose.world_from_camera, Intrinsics.from_camera(pose)))

    def fps_still(self, count: int, step: float = 0.0) -> float:
        """Frames per second at full resolution: each turned otherwise, and from `step` metres farther ahead."""
        start, seconds = self.session.state.viewpoint, []
        for number in range(count + 2):
            view = camera.look(start, 0.1 * math.sin(number), 0.0)
            snapshot = resolve(self.session.state, *self.size)
            pose = view.fit_camera(*self.size)
            ahead = pose.world_from_camera.copy()
            ahead[:3, 3] += number * step * ahead[:3, 2]
            snapshot = replace(snapshot, camera=replace(pose, world_from_camera=ahead))
            began = time.perf_counter()
            self.view.renderer.render(snapshot)
            seconds.append(time.perf_counter() - began)
        return 1 / statistics.median(seconds[2:])

    def fps_moving(self, seconds: float) -> float:
        """Frames shown per second while the camera turns without a pause."""
        start, shown = self.session.state.viewpoint, []
        began = time.perf_counter()
        while (passed := time.perf_counter() - began) < seconds + 1:
            self.session.navigation.look_from(camera.look(start, 0.2 * math.sin(3 * passed), 0.0))
            self.frame()
            if passed > 1 and (not shown or self.view.snapshot is not shown[-1]):
                shown.append(self.view.snapshot)
            self._woken.wait(FRAME)
            self._woken.clear()
        self.session.navigation.look_from(start)
        self.settle()
        return len(shown) / seconds

    def draft_psnr(self) -> float:
        """PSNR (dB) against sharp frames of what is shown while the camera moves, enlarged as the window does; median
        over directions. Call it after `fps_moving`: how coarse drafts are depends on the machine."""
        start, found = self.session.state.viewpoint, []
        for turn in DRAFT_TURNS:
            view = camera.look(start, turn, 0.0)
            snapshot = replace(resolve(self.session.state, *self.size), camera=view.fit_camera(*self.size))
            pictures = []
            for draft in (True, False):
                self.view.renderer.render(replace(snapshot, draft=draft))
                picture = Image.fromarray(self.view.renderer.read_picture())
                pictures.append(np.asarray(picture.resize(self.size, Image.Resampling.BILINEAR)) / 255)
            found.append(psnr(*pictures))
        return statistics.median(value for value in found if value is not None)

    def click_seconds(self, count: int) -> float:
        """Median time of a frame in which a click selects an instance."""
        rng, taken, (width, height) = np.random.default_rng(5), [], self.size
        while len(taken) < count:
            click = Click(float(rng.uniform(0, width)), float(rng.uniform(height / 3, height)))
            snapshot = self.view.snapshot
            assert snapshot is not None
            seconds = self.frame(lambda click=click, snapshot=snapshot: self.tool.click(click, snapshot))
            if self.session.selection.ids:
                taken.append(seconds)
            self.settle()
        return statistics.median(taken)

    def delete_seconds(self, count: int) -> float:
        """Median time of a frame in which an instance is deleted; each is undone before the next."""
        session, taken = self.session, []
        assert session.document is not None
        visible = session.document.find_visible_instances()
        for number in range(count):
            taken.append(self.frame(lambda instance=visible[7 * number]: session.deletion.delete((instance,))))
            self.frames_until(lambda: session.jobs.current is None)
            session.history.undo()
        self.settle()
        return statistics.median(taken)

    def edit_seconds(self, count: int) -> dict[str, float]:
        """Median time of the frames in which instances are deleted, tinted and painted, and of those that undo it."""
        session, taken = self.session, {"delete": [], "recolor": [], "paint": [], "undo": []}
        assert session.document is not None
        visible = session.document.find_visible_instances()
        for number in range(count):
            instance = (visible[7 * number % len(visible)],)
            steps = {
                "recolor": lambda instance=instance: session.colors.recolor(instance, "tint", (0.8, 0.2, 0.1)),
                "paint": lambda instance=instance: session.colors.recolor(instance, "paint", (0.8, 0.2, 0.1)),
                "delete": lambda instance=instance: session.deletion.delete(instance),
            }
            for name, step in steps.items():
                taken[name].append(self.frame(step))
                self.settle()
                taken["undo"].append(self.frame(session.history.undo))
                self.settle()
        return {name: statistics.median(seconds) for name, seconds in taken.items()}

    def brush_seconds(self, moves: int) -> float:
        """Median time of a move of the brush: what lies under it is marked in the whole scene."""
        session, snapshot = self.session, self.view.snapshot
        assert snapshot is not None
        tool = create_tools(session, lambda asked: self.view.renderer.read_rows(asked))["brush"]
        width, height = snapshot.camera.width, snapshot.camera.height
        path = [(width * (0.2 + 0.6 * part / moves), height * 0.6) for part in range(moves + 1)]
        tool.hover(*path[0], snapshot)
        taken = []
        for point in path[1:]:
            begun = time.perf_counter()
            tool.drag(path[0], point)
            taken.append(time.perf_counter() - begun)
        tool.cancel()
        return statistics.median(taken[1:])  # the first one looks at where everything is

    def range_seconds(self, moves: int) -> float:
        """Median time of a move of the slider that selects a range of sizes."""
        session, taken = self.session, []
        session.filter.choose("size")
        low, high = session.filter.find_limits()
        for part in range(1, moves + 1):
            begun = time.perf_counter()
            session.filter.select_range(low, low + (high - low) * part / (2 * moves))
            taken.append(time.perf_counter() - begun)
        session.history.undo()
        self.settle()
        return statistics.median(taken)


@contextmanager
def driven_editor(context: moderngl.Context, size: tuple[int, int]) -> Iterator[DrivenEditor]:
    """An editor without a window, closed at the end."""
    editor = DrivenEditor(context, size)
    try:
        yield editor
    finally:
        editor.sketch_view.release()
        editor.view.release()
        editor.session.close()
