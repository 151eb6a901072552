"""The OpenGL renderer: all passes of one frame, each drawn again only when something that it shows has changed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import moderngl
import numpy as np
from jaxtyping import Float32, UInt8, UInt32
from numpy import ndarray

from instdrive_app.render.frame_keys import (
    DRAFT_FACTOR,
    FLAT_MODES,
    make_camera_key,
    make_snapshot_key,
    round_to_figure,
)
from instdrive_app.render.gl.color_pass import ColorPass
from instdrive_app.render.gl.frame_clock import FrameClock
from instdrive_app.render.gl.gpu_scene import GpuScene
from instdrive_app.render.gl.id_pass import IdPass
from instdrive_app.render.gl.outline_pass import OutlinePass
from instdrive_app.render.gl.present_pass import PresentPass
from instdrive_app.render.gl.projector import Projector
from instdrive_app.render.gl.rings_pass import RingsPass
from instdrive_app.render.gl.sky_pass import SkyPass
from instdrive_app.render.gl.targets import Targets
from instdrive_app.render.winner_frames import WinnerFrames
from instdrive_app.state import SPLAT_MODES, FrameSnapshot, ViewMode
from instdrive_core.edits.document.document import Document
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.selection import Flag


class GlRenderer:
    """A `FrameRenderer` on OpenGL: draws off screen, and `picture` is what the window shows."""

    def __init__(
        self,
        ctx: moderngl.Context,
        document: Document,
        wake: Callable[[], None] = lambda: None,
        in_full_floats: bool = False,
    ) -> None:
        """
        Args:
            wake: called from another thread when a still view's pixels know what they stand for.
            in_full_floats: colours are blended in 32 bits instead of 16, to be compared with others.
        """
        self._ctx, self._document, self._in_full_floats = ctx, document, in_full_floats
        self.scene = GpuScene(ctx, document)
        self._projector = Projector(ctx, len(document.scene))
        self._sky, self._color, self._ids = SkyPass(ctx), ColorPass(ctx, self._projector), IdPass(ctx, self._projector)
        self._rings = RingsPass(ctx, self._projector)
        self._present, self._outline = PresentPass(ctx), OutlinePass(ctx)
        self._targets: Targets | None = None
        self._retired: list[Targets] = []
        self._keys: dict[str, object] = {}
        self._winners = WinnerFrames(document, wake)
        self._asked_winners: object = None
        self._winners_due = False
        self.blended_draws = 0
        """How often splats were blended; it does not rise while nothing changes."""
        self._clock = FrameClock(ctx)
        self.shown: FrameSnapshot | None = None
        """The snapshot that `picture` was drawn for; None before the first frame."""

    @property
    def frame_seconds(self) -> float:
        """Seconds that the last frame took which had to be blended; known when the next frame is asked for."""
        return self._clock.seconds

    @property
    def picture(self) -> moderngl.Texture | None:
        """The last frame, RGBA8, row 0 at the top; None before the first."""
        return None if self._targets is None else self._targets.shown

    @property
    def depth_range(self) -> tuple[float, float]:
        """Metres at the near and far end of the depth view's ramp."""
        low, high = self._projector.depth_range
        return round_to_figure(low, down=True), round_to_figure(high, down=False)

    @property
    def settled(self) -> bool:
        """Whether the last frame showed all splats in the right order, and what its pixels stand for; if not, a later
        one will."""
        return self._projector.current and self.scene.complete and not self._winners_due

    def render(self, snapshot: FrameSnapshot, wait: bool = True) -> None:
        """Bring `picture` up to date.

        Without `wait` no frame waits for sorting or for the upload of many splats: the last order serves until the new
        one is ready, and a large scene appears over a few frames; see `settled`.
        """
        self._clock.read()
        with self._clock:
            before = self.blended_draws
            self._bring_up_to_date(snapshot, wait)
            self._clock.counts = self.blended_draws != before
        self.shown = snapshot

    def _bring_up_to_date(self, snapshot: FrameSnapshot, wait: bool) -> None:
        self.scene.update(snapshot.time, snapshot.camera.lag, wait)
        targets = self._find_targets(snapshot)
        self._projector.sort(self.scene, snapshot.camera, wait)
        self._winners_due = False
        if snapshot.view_mode in FLAT_MODES:
            self._draw_rows(targets, snapshot, wait)
        else:
            self._draw_blended(targets, snapshot)
        marked = snapshot.show_outlines and not snapshot.draft and self._has_marks(snapshot)
        if marked:
            self._draw_rows(targets, snapshot, wait)
        shown = (make_snapshot_key(snapshot), self.scene.look_version, self.scene.id_version, self._projector.serial)
        shows_rows = marked or snapshot.view_mode in FLAT_MODES
        shown = (*shown, marked and self._document.versions.states, shows_rows and self._keys.get("rows"))
        if self._keys.get("shown") == shown:
            return
        self._present.draw(targets, self.scene, snapshot.view_mode, self.depth_range, snapshot.safe_colors)
        if marked:
            tint = snapshot.view_mode not in FLAT_MODES
            self._outline.draw(targets, self.scene, snapshot.hovered, tint, snapshot.line_width)
        self._keys["shown"] = shown

    def free_retired(self) -> None:
        """Free targets of sizes that are no longer drawn.

        Call it between window frames: a frame's draw list names its texture by number, and the driver reuses the number
        of a freed texture.
        """
        for targets in self._retired:
            targets.release()
        self._retired.clear()

    def read_rows(self, snapshot: FrameSnapshot) -> UInt32[ndarray, "h w"]:
        """Row + 1 of the splat that every pixel stands for, by the rule of clicks; 0 = none."""
        self.scene.update(snapshot.time, snapshot.camera.lag)
        winner = self._winners.find(snapshot, self._make_winner_key(snapshot), wait=True)
        assert winner is not None, "it was waited for"
        return (winner + 1).astype(np.uint32)

    def read_instance_ids(self, snapshot: FrameSnapshot) -> UInt32[ndarray, "h w"]:
        """The instance that every pixel stands for; 0 = none."""
        rows = self.read_rows(snapshot)
        with_none = np.append(np.uint32(0), self._document.scene.instance_ids)
        return with_none[rows]

    def read_row_at(self, snapshot: FrameSnapshot, x: int, y: int) -> int | None:
        """The splat that a pixel stands for; None where none is, or outside."""
        if not (0 <= x < snapshot.camera.width and 0 <= y < snapshot.camera.height):
            return None
        row_plus_one = int(self.read_rows(snapshot)[y, x])
        return row_plus_one - 1 if row_plus_one else None

    def read_picture(self) -> UInt8[ndarray, "h w 3"]:
        """The last frame as RGB."""
        assert self.picture is not None, "render was never called"
        pixels = np.frombuffer(self.picture.read(alignment=1), np.uint8)
        return pixels.reshape(self.picture.size[1], self.picture.size[0], 4)[..., :3].copy()

    def read_blended(self) -> Float32[ndarray, "h w 4"]:
        """Read the blended target of the last colour or depth frame: premultiplied over the sky; alpha is coverage."""
        assert self._targets is not None, "render was never called"
        kind = np.float32 if self._targets.in_full_floats else np.float16
        pixels = np.frombuffer(self._targets.blended.read(alignment=1), kind)
        width, height = self._targets.blended_size
        return pixels.reshape(height, width, 4).astype(np.float32)

    def release(self) -> None:
        """Free everything on the GPU."""
        passes = (self._sky, self._color, self._rings, self._ids, self._present, self._outline)
        for thing in (*passes, self._projector, self.scene):
            thing.release()
        self._winners.release()
        self._clock.release()
        self.free_retired()
        if self._targets is not None:
            self._targets.release()

    def _find_targets(self, snapshot: FrameSnapshot) -> Targets:
        size = (snapshot.camera.width, snapshot.camera.height)
        factor = DRAFT_FACTOR if snapshot.draft else 1
        blended_size = (max(1, size[0] // factor), max(1, size[1] // factor))
        in_full = self._in_full_floats or snapshot.view_mode is ViewMode.DEPTH  # half floats are too coarse for metres
        targets, wanted = self._targets, (size, blended_size, in_full)
        if targets is None or (targets.size, targets.blended_size, targets.in_full_floats) != wanted:
            if targets is not None:
                self._retired.append(targets)
            targets = self._targets = Targets(self._ctx, *wanted)
            self._keys.clear()
        return targets

    def _has_marks(self, snapshot: FrameSnapshot) -> bool:
        return snapshot.hovered != 0 or bool(self._document.state.find_mask(Flag.SELECTED).any())

    def _make_look_key(self, camera: Camera) -> tuple[Any, ...]:
        """Make a key that identifies what the projected splats look like through a camera."""
        return make_camera_key(camera), self.scene.look_version, self._projector.serial, self._projector.count

    def _project(self, camera: Camera, snapshot: FrameSnapshot, factor: int = 1) -> None:
        """Bring the records up to date; `factor`: how many times smaller the camera's picture is than the view."""
        least_dot = _find_least_dot(snapshot)
        key = (self._make_look_key(camera), least_dot, factor)
        if self._keys.get("records") != key:
            self._projector.project(self.scene, camera, least_dot, factor)
            self._keys["records"] = key

    def _draw_blended(self, targets: Targets, snapshot: FrameSnapshot) -> None:
        show_depth = snapshot.view_mode is ViewMode.DEPTH
        look = snapshot.id_opacity if snapshot.view_mode in SPLAT_MODES else None
        key = (self._make_look_key(snapshot.camera), snapshot.view_mode, look, snapshot.show_sky)
        if self._keys.get("blended") == key:
            return
        camera = snapshot.camera.resize(*targets.blended_size)
        self._project(camera, snapshot, DRAFT_FACTOR if snapshot.draft else 1)
        if show_depth:
            self._sky.draw(targets.blended_buffer, camera, None, (0.0, 0.0, 0.0))
        else:
            self._sky.draw(targets.blended_buffer, camera, self.scene.sky if snapshot.show_sky else None)
        if snapshot.view_mode is ViewMode.RINGS:
            self._rings.draw(targets.blended_buffer, snapshot.id_opacity)
        else:
            self._color.draw(targets.blended_buffer, show_depth)
        self._keys["blended"] = key
        self.blended_draws += 1

    def _draw_rows(self, targets: Targets, snapshot: FrameSnapshot, wait: bool) -> None:
        """Bring `targets.rows` up to date: by the rule of clicks where the view is still and that is known, else the
        nearest solid splats."""
        wanted = self._make_winner_key(snapshot)
        is_still = wait or wanted == self._asked_winners
        self._asked_winners = wanted
        winner = self._winners.find(snapshot, wanted, wait) if is_still and not snapshot.draft else None
        self._winners_due = winner is None
        if winner is not None:
            if self._keys.get("rows") != (wanted, "winners"):
                targets.write_rows((winner + 1).astype(np.uint32))
                self._keys["rows"] = wanted, "winners"
            return
        key = (self._make_look_key(snapshot.camera), snapshot.id_opacity, _find_least_dot(snapshot))
        if self._keys.get("rows") == key:
            return
        self._project(snapshot.camera, snapshot)
        self._ids.draw(targets, snapshot.id_opacity)
        self._keys["rows"] = key

    def _make_winner_key(self, snapshot: FrameSnapshot) -> tuple[Any, ...]:
        """Make a key that is equal where pixels stand for the same splats."""
        mode = snapshot.view_mode if snapshot.view_mode in SPLAT_MODES else None
        versions = self.scene.look_version, self.scene.id_version
        return make_camera_key(snapshot.camera), snapshot.time, versions, snapshot.id_opacity, mode


def _find_least_dot(snapshot: FrameSnapshot) -> float | None:
    """Opacity from which splats are dots; None where the view shows them whole."""
    return snapshot.id_opacity if snapshot.view_mode is ViewMode.CENTERS else None
