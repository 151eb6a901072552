"""A scripted session in the real window: open, point, click, recolour, undo, delete, recolour, export."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import UInt8, UInt32
from numpy import ndarray
from PIL import Image
from scipy.ndimage import distance_transform_edt

from instdrive_app.demo.showpiece import choose_showpiece_view, rank_objects
from instdrive_app.pointer import Click
from instdrive_app.render.frame_renderer import FrameRenderer
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.shell.display import has_display
from instdrive_app.shell.virtual_display import open_virtual_display
from instdrive_app.shell.window import EditorWindow
from instdrive_app.shell.window_layout import WindowOptions
from instdrive_app.state import ViewMode, resolve
from instdrive_core.errors import InstDriveError
from instdrive_core.files.atomic import write_bytes
from instdrive_core.scene.selection import Flag

PICTURE_WIDTH = 960
FIRST_COLOR, SECOND_COLOR = (0.93, 0.49, 0.10), (0.15, 0.38, 0.80)
PATIENCE_FRAMES = 100_000


class ScriptError(InstDriveError):
    """The scripted session cannot continue with this scene."""


def run_scripted_session(scene_path: str | Path, out_dir: str | Path, size: tuple[int, int] = (1280, 720)) -> None:
    """Open a scene in the editor and play a session, on a virtual display where there is no real one.

    Writes into `out_dir`: color.png, id_map.png (exact ID colours), hover.png and editor.png (the whole window),
    selected.png, tinted.png (the clicked instance recoloured), deleted.png, cleaned.png (residue gone, hole filled),
    recolored.png (another instance recoloured), edited.ply, and session.json, which says what was clicked.

    Raises ScriptError where the scene shows nothing to click, DisplayError where no window can be opened.
    """
    out = Path(out_dir)
    out.mkdir(parents=True, exist_ok=True)
    session = EditorSession()
    with nullcontext() if has_display() else open_virtual_display(size):
        window = EditorWindow(session, WindowOptions(size, remember_layout=False))
        session.files.open(Path(scene_path))
        window.run(lambda running: ScriptedSession(running, out).play())


class ScriptedSession:
    """The steps of the session; each `yield` lets the window draw a frame."""

    def __init__(self, window: EditorWindow, out: Path) -> None:
        self._window, self._out = window, out
        self._session = window.session
        self._pictures: list[str] = []
        self._protocol: dict[str, object] = {"pictures": self._pictures}

    def play(self) -> Iterator[None]:
        """Play the session, from opening the scene to exporting it."""
        yield from self._wait_until_open()
        yield from self._choose_view()
        self._save("color.png")
        ids = self._save_id_map()
        first, second = self._find_targets(ids)
        yield from self._point_at(first)
        yield from self._save_window("hover.png")
        yield from self._click(first, "picked")
        self._save("selected.png", outlines=True)
        yield from self._save_window("editor.png")
        self._session.colors.recolor(self._session.selection.ids, "tint", FIRST_COLOR)
        yield from self._wait_until_drawn()
        self._save("tinted.png")
        self._run("edit.undo")
        self._run("edit.delete")
        yield from self._wait_until_drawn()
        self._save("deleted.png")
        yield from self._clean_up()
        self._save("cleaned.png")
        yield from self._point_at(second)
        yield from self._click(second, "recolored")
        self._session.colors.recolor(self._session.selection.ids, "paint", SECOND_COLOR)
        yield from self._wait_until_drawn()
        self._save("recolored.png")
        yield from self._export()
        content = json.dumps(self._protocol, indent=2) + "\n"
        write_bytes(self._out / "session.json", content.encode())

    # ------------------------------------------------------------------ steps

    def _wait_until_open(self) -> Iterator[None]:
        while self._session.document is None:
            if self._session.jobs.current is None:
                raise ScriptError(self._session.messages.log[-1].text)
            yield
        yield from self._wait_until_drawn()

    def _choose_view(self) -> Iterator[None]:
        document = self._session.document
        assert document is not None
        if document.scene.views:
            index = choose_showpiece_view(self._renderer, self._session)
            self._session.navigation.look_through(index)
            view = document.scene.views[index]
            self._protocol["view"] = {"camera": view.name, "index": view.index, "time": view.time}
        yield from self._wait_until_drawn()

    def _find_targets(self, ids: UInt32[ndarray, "h w"]) -> tuple[int, int]:
        assert self._session.document is not None
        things = rank_objects(self._session.document.scene, ids)
        if len(things) < 2:
            raise ScriptError("fewer than two objects are visible from the chosen camera; train the scene for longer")
        return things[0], things[1]

    def _point_at(self, instance: int) -> Iterator[None]:
        """Hold the pointer over the middle of an instance's visible part."""
        snapshot = self._window.ui.view.snapshot
        assert snapshot is not None
        self._window.ui.script_pointer = find_inner_pixel(self._renderer.read_instance_ids(snapshot) == instance)
        yield from self._wait_until_drawn()

    def _click(self, instance: int, name: str) -> Iterator[None]:
        ui = self._window.ui
        pointer, snapshot = ui.script_pointer, ui.view.snapshot
        assert pointer is not None
        assert snapshot is not None
        picked = ui.tool.click(Click(*pointer), snapshot)
        if not picked:
            raise ScriptError(f"a click on instance {instance} at {pointer} picked nothing")
        assert self._session.document is not None
        self._protocol[f"{name}_id"] = picked
        self._protocol[f"{name}_name"] = self._session.document.scene.table[picked].name
        self._protocol[f"{name}_pixel"] = self._find_picture_pixel(pointer)
        yield from self._wait_until_drawn()

    def _clean_up(self) -> Iterator[None]:
        """Delete the residue of the deletion, and fill the hole in the ground."""
        review = self._session.deletion.review
        yield from self._wait_for_jobs()
        found = review.findings
        self._protocol["residue"] = found.residue_count if found else 0
        self._protocol["hole"] = round(found.report.hole_area, 2) if found else 0.0
        assert self._session.document is not None
        review.absorb()
        before = len(self._session.document.scene)
        review.fill()
        yield from self._wait_for_jobs()
        self._protocol["filled"] = len(self._session.document.scene) - before
        yield from self._wait_until_drawn()

    def _wait_for_jobs(self) -> Iterator[None]:
        """Wait until no job waits or runs."""
        while self._session.jobs.current is not None:
            yield

    def _export(self) -> Iterator[None]:
        document = self._session.document
        assert document is not None
        target = self._out / "edited.ply"
        self._session.export.write(target)
        yield from self._wait_for_jobs()
        if self._session.files.last_export != target:
            raise ScriptError(self._session.messages.log[-1].text)
        self._protocol["exported"] = target.name
        self._protocol["exported_splats"] = int(np.count_nonzero(~document.state.find_mask(Flag.DELETED)))

    def _run(self, action: str) -> None:
        if not self._session.actions.run(action):
            raise ScriptError(f"the action {action} is not available")

    def _wait_until_drawn(self) -> Iterator[None]:
        """Wait some frames, until the picture is sharp."""
        for frame in range(PATIENCE_FRAMES):
            yield
            if frame >= 3 and self._window.ui.view.settled:
                return

    # ------------------------------------------------------------------ pictures

    @property
    def _renderer(self) -> FrameRenderer:
        return self._window.ui.view.renderer

    @property
    def _picture_size(self) -> tuple[int, int]:
        lens = self._session.state.viewpoint.lens
        return PICTURE_WIDTH, round(PICTURE_WIDTH * lens.height / lens.width)

    def _render_picture(self, mode: ViewMode, outlines: bool) -> UInt8[ndarray, "h w 3"]:
        state = replace(self._session.state, view_mode=mode, show_outlines=outlines, hovered=0)
        self._renderer.render(resolve(state, *self._picture_size))
        return self._renderer.read_picture()

    def _save(self, name: str, outlines: bool = False) -> None:
        self._write(name, self._render_picture(ViewMode.COLOR, outlines))

    def _save_id_map(self) -> UInt32[ndarray, "h w"]:
        self._write("id_map.png", self._render_picture(ViewMode.INSTANCE, outlines=False))
        return self._renderer.read_instance_ids(resolve(self._session.state, *self._picture_size))

    def _find_picture_pixel(self, pointer: tuple[float, float]) -> list[int]:
        """Convert a position in the viewport into column and row of the saved pictures."""
        snapshot = self._window.ui.view.snapshot
        assert snapshot is not None
        left, top, right, _ = self._session.state.viewpoint.fit_film(snapshot.camera.width, snapshot.camera.height)
        scale = self._picture_size[0] / (right - left)
        return [int((pointer[0] - left) * scale), int((pointer[1] - top) * scale)]

    def _save_window(self, name: str) -> Iterator[None]:
        self._session.messages.dismiss()
        yield from self._window.screenshot()
        self._write(name, self._window.last_screenshot)

    def _write(self, name: str, picture: UInt8[ndarray, "h w 3"]) -> None:
        Image.fromarray(picture).save(self._out / name)
        self._pictures.append(name)


def find_inner_pixel(mask: ndarray) -> tuple[float, float]:
    """Find x, y of the pixel centre farthest from the mask's border. Raises ScriptError for an empty mask."""
    if not mask.any():
        raise ScriptError("the object to point at is not visible")
    depth = np.asarray(distance_transform_edt(np.pad(mask, 1)))
    row, column = np.unravel_index(int(depth.argmax()), depth.shape)
    return float(column) - 0.5, float(row) - 0.5
