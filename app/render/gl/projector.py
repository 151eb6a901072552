"""Projects all splats in blending order, once per camera, for the colour, depth and ID passes."""

from __future__ import annotations

import math

import moderngl
import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from instdrive_app.render.depth_order import NOTHING_SORTED, CulledView, DepthOrder, OrderSorter
from instdrive_app.render.gl.gl_state import draw_into
from instdrive_app.render.gl.gpu_scene import GpuScene
from instdrive_app.render.gl.programs import build_program, set_uniforms
from instdrive_app.render.view_cone import widen_view
from instdrive_core.rasterize.kernels.project import camera_to_row
from instdrive_core.rasterize.kernels.settings import RasterSettings
from instdrive_core.rasterize.splat_looks import DOT_OPACITY, DOT_SETTINGS
from instdrive_core.scene.camera import Camera

RECORD_FLOATS = 11
"""Numbers captured per splat: centre x, y, depth, opacity; half axes (4); colour (3)."""
KEPT_TURN = math.cos(math.radians(0.5))
"""Cosine of the angle that a moving camera may turn by before splats are sorted again …"""
KEPT_WAY = 0.5
"""… and metres that it may go along its axis: splats behind it are not sorted, and some come into view."""
SPARE_SHARE = 8
"""A buffer that grows gets room for one spare splat per this many."""


class Projector:
    """Sorts splats by depth on the CPU and projects them on the GPU into `records`, row numbers in `order`.

    Both remain the same GL objects when they grow, so vertex arrays over them stay valid.
    """

    def __init__(self, ctx: moderngl.Context, capacity: int, settings: RasterSettings | None = None) -> None:
        self._ctx, self._settings = ctx, settings or RasterSettings()
        self._program = build_program(ctx, "project.vert", captured=("splat_center", "splat_axes", "splat_color"))
        self._capacity = max(capacity, 1)
        self.order = ctx.buffer(reserve=self._capacity * 4, dynamic=True)
        self.records = ctx.buffer(reserve=self._capacity * RECORD_FLOATS * 4, dynamic=True)
        self._vertices = ctx.vertex_array(self._program, [(self.order, "1u", "row")])
        # Nothing is rasterized, yet GL wants a complete framebuffer, and a context without a window has none.
        self._no_texture = ctx.texture((1, 1), 4)
        self._no_picture = ctx.framebuffer([self._no_texture])
        self._sorter = OrderSorter()
        self._uploaded = NOTHING_SORTED
        self._last_axis = np.zeros(4, np.float32)
        self._sorted_for: tuple[ndarray, int] = (np.zeros(4, np.float32), -1)
        """Viewing axis and `pose_version` that the order belongs to."""
        self._covers = False
        """Whether the order's splats in view are all that the present camera sees."""
        self.serial = 0
        """Rises whenever the order changes."""
        self.current = False
        """Whether the order belongs to the camera and state that were asked for last."""

    @property
    def count(self) -> int:
        """Number of splats to draw: those that may be in view, or all of them where an older order does not tell."""
        return self._uploaded.in_view if self._covers else len(self._uploaded.rows)

    @property
    def depth_range(self) -> tuple[float, float]:
        """Depths (metres) that hold the middle 94 % of the splats in front of the camera."""
        return self._uploaded.depth_range

    def sort(self, scene: GpuScene, camera: Camera, wait: bool) -> None:
        """Bring `order` up to date with the camera and the splats' positions.

        Without `wait` that may happen later, and the last order serves until then.
        """
        axis, version = camera.camera_from_world[2].astype(np.float32), scene.pose_version
        if not wait and self._may_keep_order(axis, version, camera):
            return
        if not (self._is_sorted_for(axis, version) and self._uploaded.covers(camera)):
            cone = widen_view(camera)
            key = (axis.tobytes(), version, cone.apex.tobytes(), cone.normals.tobytes())
            sort = self._sorter.sort_now if wait else self._sorter.sort_soon
            order = sort(key, scene.means, axis, self._settings.near, CulledView(cone, scene.places, version))
            if order is not self._uploaded:
                self._upload(order)
        self.current = self._is_sorted_for(axis, version) and self._uploaded.covers(camera)
        self._covers = self._sees_all_in_view(version, camera)

    def _upload(self, order: DepthOrder) -> None:
        self._reserve(len(order.rows))
        if len(order.rows):
            self.order.write(order.rows)
        self._uploaded = order
        self._sorted_for = np.frombuffer(order.key[0], np.float32), order.key[1]
        self.serial += 1

    def _is_sorted_for(self, axis: Float32[ndarray, "4"], version: int) -> bool:
        return version == self._sorted_for[1] and np.array_equal(axis, self._sorted_for[0])

    def _sees_all_in_view(self, version: int, camera: Camera) -> bool:
        if self._uploaded.cone is None:
            return self.current
        return version == self._sorted_for[1] and self._uploaded.covers(camera)

    def _may_keep_order(self, axis: Float32[ndarray, "4"], pose_version: int, camera: Camera) -> bool:
        """Whether the camera moves on and has hardly turned since the last sort: the picture would not differ.

        A camera that stands still gets its exact order.
        """
        moves, self._last_axis = not np.array_equal(axis, self._last_axis), axis
        sorted_for, version = self._sorted_for
        if not moves or version != pose_version or not self._uploaded.in_view or not self._uploaded.covers(camera):
            return False
        turned = float(axis[:3] @ sorted_for[:3]) < KEPT_TURN
        if turned or abs(float(axis[3] - sorted_for[3])) > KEPT_WAY:
            return False
        self.current = bool(np.array_equal(axis, sorted_for))
        self._covers = self._sees_all_in_view(pose_version, camera)
        return True

    def project(self, scene: GpuScene, camera: Camera, least_dot: float | None = None, factor: int = 1) -> None:
        """Bring `records` up to date; call it after `sort`.

        With `least_dot`, splats at least that opaque become dots, and others are left out. The camera's picture may be
        `factor` times smaller than the one that it stands for.
        """
        if not self.count:
            return
        settings = self._settings.fit_smaller(factor) if least_dot is None else DOT_SETTINGS
        view, program = camera_to_row(camera), self._program
        scene.bind(program)
        set_uniforms(
            program,
            camera_from_world=tuple(camera.camera_from_world.T.ravel()),
            camera_position=tuple(camera.position),
            focal=(camera.fx, camera.fy),
            principal=(camera.cx, camera.cy),
            viewport=(camera.width, camera.height),
            slope_limits=tuple(float(limit) for limit in view[18:22]),
            near=settings.near,
            low_pass=settings.low_pass,
            alpha_cut=settings.min_alpha,
            antialiased=scene.antialiased and least_dot is None,
            dots=least_dot is not None,
            least_dot=least_dot or 0.0,
            dot_opacity=DOT_OPACITY,
        )
        with draw_into(self._ctx, self._no_picture):
            self._vertices.transform(self.records, moderngl.POINTS, vertices=self.count)

    def release(self) -> None:
        """Free program and buffers, and end the sorting thread."""
        self._sorter.release()
        for thing in (self._vertices, self.order, self.records, self._program, self._no_picture, self._no_texture):
            thing.release()

    def _reserve(self, count: int) -> None:
        if count > self._capacity:
            self._capacity = count + count // SPARE_SHARE
            self.order.orphan(self._capacity * 4)
            self.records.orphan(self._capacity * RECORD_FLOATS * 4)
