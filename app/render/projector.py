"""Projection of all splats in blending order, once per camera, shared by the colour, depth and ID passes."""

from __future__ import annotations

import moderngl
import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from instdrive_app.render.gl_state import drawing_into
from instdrive_app.render.gpu_scene import GpuScene
from instdrive_app.render.programs import build_program, set_uniforms
from instdrive_core.maths.sorting import back_to_front
from instdrive_core.rasterize.project import camera_row
from instdrive_core.rasterize.settings import RasterSettings
from instdrive_core.scene.camera import Camera

RECORD_FLOATS = 11
"""Captured per splat: centre x, y, depth, opacity; half axes (4); colour (3)."""


class Projector:
    """Sorts splats by depth on the CPU and projects them on the GPU into `records`, row numbers in `order`."""

    def __init__(self, ctx: moderngl.Context, capacity: int, settings: RasterSettings | None = None) -> None:
        self._settings = settings or RasterSettings()
        self._program = build_program(ctx, "project.vert", captured=("splat_center", "splat_axes", "splat_color"))
        capacity = max(capacity, 1)
        self.order = ctx.buffer(reserve=capacity * 4, dynamic=True)
        self.records = ctx.buffer(reserve=capacity * RECORD_FLOATS * 4, dynamic=True)
        self._vertices = ctx.vertex_array(self._program, [(self.order, "1u", "row")])
        self._ctx = ctx
        # Nothing is rasterized, yet GL wants a complete framebuffer, and a context without a window has none.
        self._no_picture = ctx.framebuffer([ctx.texture((1, 1), 4)])
        self.count = 0
        """Splats in front of the camera."""
        self.depth_range = (1.0, 100.0)
        """Depths (metres) that hold the middle 94 % of the splats in front of the camera."""

    def sort(self, scene: GpuScene, camera: Camera) -> None:
        """Bring `order` up to date with the camera and the splats' positions."""
        axis = camera.camera_from_world[2]
        depths = scene.means @ axis[:3].astype(np.float32) + np.float32(axis[3])
        order = back_to_front(depths, self._settings.near)
        self.count = len(order)
        if self.count:
            self.order.write(order)
            self.depth_range = _middle(depths[order])

    def project(self, scene: GpuScene, camera: Camera) -> None:
        """Bring `records` up to date; call after `sort`."""
        if not self.count:
            return
        view, program = camera_row(camera), self._program
        scene.bind(program)
        set_uniforms(
            program,
            camera_from_world=tuple(camera.camera_from_world.T.ravel()),
            camera_position=tuple(camera.position),
            focal=(camera.fx, camera.fy),
            principal=(camera.cx, camera.cy),
            viewport=(camera.width, camera.height),
            slope_limits=tuple(float(limit) for limit in view[18:22]),
            near=self._settings.near,
            low_pass=self._settings.low_pass,
            alpha_cut=self._settings.min_alpha,
        )
        with drawing_into(self._ctx, self._no_picture):
            self._vertices.transform(self.records, moderngl.POINTS, vertices=self.count)

    def read(self) -> Float32[ndarray, "m 11"]:
        """The records in blending order, for tests."""
        return np.frombuffer(self.records.read(self.count * RECORD_FLOATS * 4), np.float32).reshape(-1, RECORD_FLOATS)

    def release(self) -> None:
        """Free program and buffers."""
        for thing in (self._vertices, self.order, self.records, self._program, self._no_picture):
            thing.release()


def _middle(falling_depths: Float32[ndarray, " m"]) -> tuple[float, float]:
    count = len(falling_depths)
    far, near = falling_depths[int(0.03 * count)], falling_depths[min(int(0.97 * count), count - 1)]
    return float(near), float(max(far, near * 1.01))
