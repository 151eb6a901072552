"""Draws a frame on the CPU: the work of the render thread."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float32, Int32, UInt8
from numpy import ndarray

from instdrive_app.render.frame_keys import (
    DRAFT_FACTOR,
    FLAT_MODES,
    SMOOTH_SECONDS,
    make_camera_key,
    make_snapshot_key,
    round_to_figure,
)
from instdrive_app.render.picture_colors import BACKDROP
from instdrive_app.render.software.color_memory import ColorMemory
from instdrive_app.render.software.merged_splats import MergedSplats
from instdrive_app.render.software.picture import add_outlines, paint_color, paint_depth, paint_ids, paint_safe_ids
from instdrive_app.render.software.placed_splats import PlacedSplats
from instdrive_app.render.software.scene import SceneState
from instdrive_app.render.software.sparse_splats import LEAST, SparseSplats
from instdrive_app.render.software.thread import Superseded
from instdrive_app.state import ID_ALPHA_CUT, SPLAT_MODES, FrameSnapshot, ViewMode
from instdrive_core.maths.workspace import Workspace
from instdrive_core.rasterize.importance import select_most_important
from instdrive_core.rasterize.kernels.settings import DEFAULT_SETTINGS, RasterSettings
from instdrive_core.rasterize.kernels.sky_behind import add_sky
from instdrive_core.rasterize.preview import DEFAULT_PICK_RULE, Preview, blend_projected
from instdrive_core.rasterize.preview.colors import ColorSource
from instdrive_core.rasterize.preview.projection import project_part, project_splats
from instdrive_core.rasterize.preview.splats import NO_INSTANCES, NO_NAMES, ProjectedSplats
from instdrive_core.rasterize.splat_looks import DOT_LOG_SCALE, DOT_SETTINGS, RING_RULE, make_dots, paint_rings
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.selection import Flag

DRAFT_SECONDS = 1 / 16
"""Drafts of scenes without levels of detail leave out enough splats to be drawn in this time."""
FEWEST_SPLATS = 150_000
"""Splats that a draft shows at least, if the scene has as many: with fewer, walls of small splats get holes."""
_SAMPLE = 500_000
"""Splats that the depth view's range is found from at most."""
_NO_FRAMES = np.zeros(0, np.int32)


@dataclass(frozen=True)
class FrameRequest:
    """A frame to draw; nothing in it is ever written again."""

    state: SceneState
    snapshot: FrameSnapshot

    def is_for(self, state: SceneState, snapshot: FrameSnapshot) -> bool:
        """Whether the frame shows exactly this state and snapshot."""
        return self.state is state and make_snapshot_key(self.snapshot) == make_snapshot_key(snapshot)


@dataclass(frozen=True)
class DrawnFrame:
    """A drawn frame; its arrays belong to the receiver."""

    request: FrameRequest
    picture: UInt8[ndarray, "h w 4"]
    winner: Int32[ndarray, "vh vw"]
    """Row of the splat that a pixel stands for, -1 for none; a draft's array is smaller than the viewport."""
    depth_range: tuple[float, float]
    """Metres at the ends of the depth view's ramp."""
    seconds: float | None
    """Seconds that blending took; None if only the picture was composed again."""


class SoftwareDraw:
    """Draws requests, and keeps the last blended frame to compose outlines and view modes from."""

    def __init__(self, fewest: int = FEWEST_SPLATS) -> None:
        """Drafts of scenes with more splats than `fewest` are drawn with levels of detail."""
        self._workspace, self._fewest = Workspace(), fewest
        self._placed: PlacedSplats | None = None
        self._colors = ColorMemory()
        self._blended: Preview | None = None
        self._winner = np.zeros((0, 0), np.int32)
        self._found: ProjectedSplats | None = None
        self._key: object = None
        self._budget = 2 * FEWEST_SPLATS
        self._merged: MergedSplats | None = None
        self._calm = threading.Event()
        self._calm.set()
        """Set while no sharp frame is drawn: those have the cores to themselves."""
        self._sparse: SparseSplats | None = None
        self._depth_range: tuple[object, tuple[float, float]] = (None, (1.0, 100.0))
        self._instances, self._instances_number = NO_INSTANCES, 0

    def __call__(self, request: FrameRequest, newer: Callable[[], FrameRequest | None] = lambda: None) -> DrawnFrame:
        """Draw one frame. Raises Superseded if a sharp picture is asked for while the camera already moves on."""
        started, snapshot = time.perf_counter(), request.snapshot
        placed = self._update_placed(request)
        merged = self._choose_merged(placed, snapshot)
        camera = _choose_camera(snapshot, merged.factor if merged is not None else DRAFT_FACTOR)
        key = (
            make_camera_key(camera),
            snapshot.id_opacity,
            snapshot.show_sky,
            snapshot.draft,
            snapshot.view_mode if snapshot.view_mode in SPLAT_MODES else None,
            placed,
            placed.look_version,
            self._number_instances(request.state),
        )
        seconds = None
        if key != self._key:
            self._key = None  # the kept frame is overwritten, perhaps only in part
            if not snapshot.draft:
                self._calm.clear()
            try:
                if merged is None and _is_sparse(placed, snapshot):
                    self._blend_sparse(placed, camera, snapshot)
                elif merged is None or not self._blend_merged(merged, placed, camera, snapshot):
                    self._blend(placed, camera, snapshot, lambda: _check(request, newer))
            finally:
                self._calm.set()
            self._key, seconds = key, time.perf_counter() - started
            if seconds > SMOOTH_SECONDS:
                self._start_merging(placed)
            if merged is not None and snapshot.draft:
                merged.adapt(seconds)
            elif snapshot.draft and not _is_sparse(placed, snapshot):
                self._adapt(seconds, len(placed.means))
        picture = self._compose(request.state, snapshot, camera)
        return DrawnFrame(request, picture, self._winner, self._depth_range[1], seconds)

    def _number_instances(self, state: SceneState) -> int:
        """Number the state's instance IDs: another one as soon as they have changed."""
        if state.instance_ids is not self._instances:
            self._instances, self._instances_number = state.instance_ids, self._instances_number + 1
        return self._instances_number

    def wait_for_detail(self) -> None:
        """Wait until the levels of detail are built that a draft has asked for."""
        if self._merged is not None:
            self._merged.wait()

    def _update_placed(self, request: FrameRequest) -> PlacedSplats:
        state, moment = request.state, (request.snapshot.time, request.snapshot.camera.lag)
        placed = self._placed
        if placed is None or placed.state.rows_version != state.rows_version:
            placed = self._placed = PlacedSplats(state, *moment)
            self._merged = self._sparse = None
        placed.update(state, *moment)
        return placed

    def _blend(self, placed: PlacedSplats, camera: Camera, snapshot: FrameSnapshot, check: Callable[[], None]) -> None:
        state, workspace = placed.state, self._workspace
        settings = RasterSettings(antialiased=state.antialiased)
        opacities = placed.opacities
        if snapshot.draft:
            settings = settings.fit_smaller(DRAFT_FACTOR)
            arrays = placed.means, placed.areas, opacities
            opacities = select_most_important(*arrays, camera, self._budget, settings, workspace)
        log_scales = placed.log_scales
        if snapshot.view_mode is ViewMode.CENTERS:
            settings, opacities = DOT_SETTINGS, make_dots(opacities, snapshot.id_opacity)
            log_scales = np.full_like(log_scales, DOT_LOG_SCALE)
        shapes = placed.means, placed.quats, log_scales, opacities
        source = _build_color_source(placed)
        if not snapshot.draft:
            source = replace(source, remembered=self._colors.recall(placed, camera.position))
        # Rings and centres show splats, not what is seen of a scene: each can be pointed at.
        called = (NO_NAMES, NO_INSTANCES) if snapshot.view_mode in SPLAT_MODES else (state.names, self._instances)
        found = project_splats(*shapes, camera, settings, source, workspace, *called)
        check()
        self._finish(found, placed, camera, snapshot, settings)

    def _choose_merged(self, placed: PlacedSplats, snapshot: FrameSnapshot) -> MergedSplats | None:
        """Choose the splats with levels of detail if they are there."""
        if snapshot.draft:
            self._start_merging(placed)
        if self._merged is None or not self._merged.ready or snapshot.view_mode in SPLAT_MODES:
            return None
        return self._merged

    def _start_merging(self, placed: PlacedSplats) -> None:
        """Build levels of detail beside the window, once it is known that frames of this scene are slow."""
        if self._merged is None and len(placed.means) > self._fewest:
            self._merged = MergedSplats(placed, self._calm.wait)

    def _blend_merged(
        self, merged: MergedSplats, placed: PlacedSplats, camera: Camera, snapshot: FrameSnapshot
    ) -> bool:
        """Draw a draft from levels of detail, or a sharp frame of what is in view; False where that is most of it."""
        settings, workspace = RasterSettings(antialiased=placed.state.antialiased), self._workspace
        choose = merged.choose if snapshot.draft else merged.cull
        cut = choose(camera, settings.near, workspace)
        if cut is None:
            return False
        called, middle = (placed.name(cut.rows), self._instances), cut.splat_count
        found = ProjectedSplats(len(cut.means), workspace, *called)
        sources = merged.build_sources(cut, _build_color_source(placed))
        # Not so for nodes, which are wide and hide too little as it is.
        fine = settings.fit_smaller(merged.factor) if snapshot.draft else settings
        parts = (slice(0, middle), fine), (slice(middle, len(cut.means)), settings)
        for (part, chosen), source in zip(parts, sources, strict=True):
            shapes = cut.means[part], cut.quats[part], cut.log_scales[part], cut.opacities[part]
            project_part(*shapes, camera, chosen, source, found.take_part(part.start, part.stop))
        self._finish(found, placed, camera, snapshot, settings)
        return True

    def _blend_sparse(self, placed: PlacedSplats, camera: Camera, snapshot: FrameSnapshot) -> None:
        """Draw a draft of a large scene whose levels of detail are still being built."""
        settings = RasterSettings(antialiased=placed.state.antialiased)
        if self._sparse is None or not self._sparse.is_of(placed):
            self._sparse = SparseSplats(placed)
        found = self._sparse.project(camera, _build_color_source(placed), settings, self._workspace)
        self._finish(found, placed, camera, snapshot, settings)

    def _finish(
        self,
        found: ProjectedSplats,
        placed: PlacedSplats,
        camera: Camera,
        snapshot: FrameSnapshot,
        settings: RasterSettings,
    ) -> None:
        """Blend what was projected and coloured, before the sky."""
        state, workspace = placed.state, self._workspace
        usual = RING_RULE if snapshot.view_mode is ViewMode.RINGS else DEFAULT_PICK_RULE
        rule = replace(usual, min_opacity=snapshot.id_opacity, min_alpha=ID_ALPHA_CUT)
        if state.sky is not None and snapshot.show_sky:
            blended = blend_projected(found, camera, workspace, settings, rule)
            add_sky(state.sky, camera, blended.color, blended.alpha)
        else:
            blended = blend_projected(found, camera, workspace, settings, rule, BACKDROP)
        self._blended, self._winner, self._found = blended, blended.winner, found

    def _adapt(self, seconds: float, count: int) -> None:
        wanted = self._budget * float(np.clip(DRAFT_SECONDS / seconds, 0.7, 1.4))
        self._budget = int(np.clip(wanted, min(FEWEST_SPLATS, count), max(count, 1)))

    def _compose(self, state: SceneState, snapshot: FrameSnapshot, camera: Camera) -> UInt8[ndarray, "h w 4"]:
        blended, winner = self._blended, self._winner
        assert blended is not None
        if snapshot.view_mode is ViewMode.RINGS and self._found is not None:
            picture = paint_color(paint_rings(self._found, winner, ID_ALPHA_CUT, BACKDROP))
        elif snapshot.view_mode in (ViewMode.COLOR, ViewMode.CENTERS):
            picture = paint_color(blended.color)
        elif snapshot.view_mode is ViewMode.DEPTH:
            picture = paint_depth(blended.depth, blended.alpha, self._find_depth_range(camera))
        else:
            flat = state.codewords if snapshot.view_mode is ViewMode.CODEWORD else state.instance_ids
            picture = (paint_safe_ids if snapshot.safe_colors else paint_ids)(winner, flat)
        if snapshot.show_outlines and not snapshot.draft and _has_marks(state, snapshot):
            tint = snapshot.view_mode not in FLAT_MODES
            add_outlines(picture, winner, state.flags, state.instance_ids, snapshot.hovered, tint, snapshot.line_width)
        return picture

    def _find_depth_range(self, camera: Camera) -> tuple[float, float]:
        """Depths (metres) that hold the middle 94 % of the splats in front of the camera, widened to round figures."""
        placed = self._placed
        assert placed is not None
        key = (camera.world_from_camera.tobytes(), placed, placed.look_version)
        if self._depth_range[0] != key:
            self._depth_range = (key, _compute_depth_range(placed.means, camera))
        return self._depth_range[1]


def _is_sparse(placed: PlacedSplats, snapshot: FrameSnapshot) -> bool:
    """Whether a draft without levels of detail shows every k-th splat."""
    return snapshot.draft and snapshot.view_mode not in SPLAT_MODES and len(placed.means) > LEAST


def _choose_camera(snapshot: FrameSnapshot, factor: int) -> Camera:
    camera = snapshot.camera
    if not snapshot.draft or factor == 1:
        return camera
    return camera.resize(max(1, camera.width // factor), max(1, camera.height // factor))


def _check(request: FrameRequest, newer: Callable[[], FrameRequest | None]) -> None:
    following = newer()
    if following is not None and following.snapshot.draft and not request.snapshot.draft:
        raise Superseded


def _build_color_source(placed: PlacedSplats) -> ColorSource:
    state, gaussians = placed.state, placed.state.gaussians
    return ColorSource(
        sh_dc=gaussians.sh_dc,
        sh_rest=gaussians.sh_rest,
        frames=placed.frames if placed.turned else _NO_FRAMES,
        rotations=placed.rotations,
        entries=state.color_entries,
        matrices=np.ascontiguousarray(state.color_values[:, :12]).reshape(-1, 3, 4),
    )


def _has_marks(state: SceneState, snapshot: FrameSnapshot) -> bool:
    return snapshot.hovered != 0 or bool((state.flags & np.uint8(Flag.SELECTED)).any())


def _compute_depth_range(means: Float32[ndarray, "n 3"], camera: Camera) -> tuple[float, float]:
    axis = camera.camera_from_world[2].astype(np.float32)
    depths = means[:: max(1, len(means) // _SAMPLE)] @ axis[:3] + axis[3]
    depths = depths[depths > DEFAULT_SETTINGS.near]
    count = len(depths)
    if not count:
        return 1.0, 100.0
    places = max(count - 1 - int(0.97 * count), 0), count - 1 - int(0.03 * count)
    near, far = np.partition(depths, places)[list(places)]
    return round_to_figure(float(near), down=True), round_to_figure(float(max(far, near * 1.01)), down=False)
