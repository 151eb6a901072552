"""The handles that move, rotate and scale the selection, with the selection's box and lane."""

from __future__ import annotations

import numpy as np
from imgui_bundle import imgui, imguizmo
from jaxtyping import Float64
from numpy import ndarray

from instdrive_app.panels.overlays.world_pen import WorldPen
from instdrive_app.panels.widgets.theme import pack_color
from instdrive_app.panels.widgets.ui import Rectangle, Ui, scale_pixels
from instdrive_app.pointer import Operation
from instdrive_app.preferences.themes import PICTURE_ACCENT, PICTURE_TEXT
from instdrive_app.session.move_controller import MoveController
from instdrive_app.session.selection_box import BOX_EDGES, Box, compute_upright_axes
from instdrive_core.scene.camera import Camera

guizmo = imguizmo.im_guizmo

HANDLE_PIXELS = 84.0
"""Length of the gizmo's axes, at scale 1."""
MARK = 5.0
"""Half the side, in pixels, of the mark of a handle."""
LINES = {
    "translation_line_thickness": 3.0,
    "translation_line_arrow_size": 6.0,
    "rotation_line_thickness": 2.0,
    "rotation_outer_line_thickness": 3.0,
    "scale_line_thickness": 3.0,
    "scale_line_circle_size": 6.0,
    "hatched_axis_line_thickness": 6.0,
    "center_circle_size": 6.0,
}
"""Lengths of ImGuizmo's style, in pixels at scale 1."""
SNAPS: dict[Operation, float] = {"move": 0.25, "rotate": 5.0, "scale": 0.1}
"""Steps while Ctrl is held: metres, degrees, and a factor."""
NEAR, FAR = 0.05, 4000.0
"""Metres between which ImGuizmo's projection places things."""
RING = 1.2
"""Radius of the rings, as a multiple of the axes' length."""
LANE_METRES = 15.0
"""Length of lane shown to either side."""


class Gizmo:
    """Shows handles while the current tool has an operation and something is selected."""

    def __init__(self) -> None:
        self.holds_mouse: bool = False
        self._given_up = False
        """Whether Escape ended the drag while the button is still pressed."""
        self._matrix = np.eye(4)
        """The gizmo's pose relative to where the drag began; the columns' lengths are the scale."""

    def draw(self, ui: Ui, place: Rectangle) -> None:
        """Draw one frame."""
        operation, moving, snapshot = ui.tool.operation, ui.session.movement, ui.view.snapshot
        if operation is None or not moving.ids or snapshot is None:
            self.holds_mouse = False
            moving.end_drag()
            return
        camera, box = snapshot.camera, moving.find_box()
        pen = WorldPen(camera, place)
        pen.draw_lines(box.corners[np.array(BOX_EDGES)], pack_color(PICTURE_ACCENT, 0.45))
        for path in moving.find_paths():
            pen.draw_path(path, pack_color(PICTURE_TEXT, 0.7))
        drag = moving.drag
        axes = choose_gizmo_axes(moving, box, operation) if drag is None else drag.axes
        if operation == "move" and moving.options.along_lane:
            reach = LANE_METRES * axes[:, 1]
            pen.draw_dashes(moving.find_center() - reach, moving.find_center() + reach, pack_color(PICTURE_TEXT, 0.55))
        self._manipulate(ui, place, camera, operation, axes)
        length = scale_pixels(HANDLE_PIXELS) * place.density / camera.fx
        _mark_handles(ui, pen, camera, operation, moving.find_center(), length * axes)

    def _manipulate(
        self, ui: Ui, place: Rectangle, camera: Camera, operation: Operation, axes: Float64[ndarray, "3 3"]
    ) -> None:
        """Let ImGuizmo turn mouse movement into a matrix, relative to where the drag began, and apply it."""
        moving = ui.session.movement
        center = moving.find_center() if moving.drag is None else moving.drag.center
        if moving.drag is None:
            self._matrix = np.eye(4)
            self._matrix[:3, :3] = axes
        _configure_gizmo(moving, place, operation)
        matrix = _to_matrix16(self._matrix)
        view = compute_gl_view(camera)
        view[:3, 3] += view[:3, :3] @ center
        step = SNAPS[operation] if imgui.get_io().key_ctrl else None
        changed = guizmo.manipulate(
            _to_matrix16(view),
            _to_matrix16(compute_gl_projection(camera)),
            _choose_handles(moving, operation),
            guizmo.MODE.local,
            matrix,
            snap=None if step is None else guizmo.Matrix3([step] * 3),
        )
        if moving.drag is not None and imgui.is_key_pressed(imgui.Key.escape):
            moving.cancel_drag()
            self._given_up = True
            guizmo.enable(False)  # which makes it let go
            guizmo.enable(True)
        self._given_up &= imgui.is_mouse_down(0)
        using = guizmo.is_using()
        if using and moving.drag is None:
            moving.begin_drag(axes)
        if using and changed:
            self._matrix = np.array(matrix.values, np.float64).reshape(4, 4).T
            moving.drag_to(*extract_change(self._matrix, axes))
            if operation == "move" and moving.drag is not None:  # the handles go where the constraints let things go
                self._matrix[:3, 3] = moving.find_center() - center
        if not using:
            moving.end_drag()
        # A press that began elsewhere, to turn the camera, goes on across the handles.
        held = using or self._given_up
        self.holds_mouse = held or (guizmo.is_over() and not any(imgui.is_mouse_down(button) for button in range(3)))


def choose_gizmo_axes(moving: MoveController, box: Box, operation: Operation) -> Float64[ndarray, "3 3"]:
    """The handles' axes as columns x, y, z: the box's without its tilt; y follows the lane if moves are bound to it."""
    lane = moving.find_lane() if operation == "move" and moving.options.along_lane else None
    return box.upright_axes if lane is None else compute_upright_axes(lane)


def compute_gl_view(camera: Camera) -> Float64[ndarray, "4 4"]:
    """Compute the transform from the world to OpenGL's camera axes (y up, z backwards)."""
    return np.diag([1.0, -1.0, -1.0, 1.0]) @ camera.camera_from_world


def compute_gl_projection(camera: Camera) -> Float64[ndarray, "4 4"]:
    """Compute the transform from OpenGL's camera axes to clip space.

    A point falls on the same pixel as by `Camera.project`.
    """
    width, height = camera.width, camera.height
    depth = (NEAR + FAR) / (NEAR - FAR)
    return np.array(
        [
            [2 * camera.fx / width, 0.0, 1 - 2 * camera.cx / width, 0.0],
            [0.0, 2 * camera.fy / height, 2 * camera.cy / height - 1, 0.0],
            [0.0, 0.0, depth, 2 * FAR * NEAR / (NEAR - FAR)],
            [0.0, 0.0, -1.0, 0.0],
        ]
    )


def extract_change(
    matrix: Float64[ndarray, "4 4"], axes: Float64[ndarray, "3 3"]
) -> tuple[Float64[ndarray, "3"], Float64[ndarray, "3 3"], float]:
    """Split a gizmo's matrix, whose columns were `axes`, into shift (metres), rotation and scale.

    Scaling is uniform: the handle that was pulled farthest counts.
    """
    lengths = np.linalg.norm(matrix[:3, :3], axis=0)
    farthest = int(np.argmax(np.abs(np.log(lengths))))  # things scale evenly: the handle that was pulled counts
    left, _, right = np.linalg.svd(matrix[:3, :3] / lengths @ axes.T)  # ImGuizmo adds up turns in 32 bits
    return matrix[:3, 3], left @ right, float(lengths[farthest])


def _to_matrix16(matrix: Float64[ndarray, "4 4"]) -> guizmo.Matrix16:
    """Convert to ImGuizmo's matrix, column by column."""
    return guizmo.Matrix16(matrix.T.reshape(-1).tolist())


def _configure_gizmo(moving: MoveController, place: Rectangle, operation: Operation) -> None:
    options, moves = moving.options, operation == "move"
    guizmo.begin_frame()
    guizmo.set_drawlist(imgui.get_window_draw_list())
    guizmo.set_orthographic(False)
    guizmo.set_rect(place.x, place.y, place.width, place.height)
    guizmo.set_gizmo_size_clip_space(2 * scale_pixels(HANDLE_PIXELS) / max(place.width, place.height))
    guizmo.allow_axis_flip(False)
    style = guizmo.get_style()
    for name, pixels in LINES.items():
        setattr(style, name, scale_pixels(pixels))
    guizmo.set_axis_mask(False, False, moves and options.on_ground and not options.along_lane)


def _choose_handles(moving: MoveController, operation: Operation) -> guizmo.OPERATION:
    kinds = guizmo.OPERATION
    if operation == "rotate":
        return kinds.rotate_z if moving.yaw_only else kinds.rotate
    if operation == "move":
        # Where an axis is masked, ImGuizmo takes no other one near it: along a lane that leads away none could be had.
        return kinds.translate_y if moving.options.along_lane else kinds.translate
    return kinds.scale


def _mark_handles(
    ui: Ui,
    pen: WorldPen,
    camera: Camera,
    operation: Operation,
    center: Float64[ndarray, "3"],
    axes: Float64[ndarray, "3 3"],
) -> None:
    """Mark where the handles are, for whatever drives the window; `axes` are as long as drawn at a depth of 1."""
    depth = float((camera.camera_from_world @ [*center, 1.0])[2])
    axes = depth * axes
    ends = {name: center + 0.8 * axes[:, column] for column, name in enumerate("xyz")}
    if operation == "rotate":
        length = float(np.linalg.norm(axes[:, 0]))
        towards = (camera.position - center) @ axes[:, :2] @ axes[:, :2].T
        ends = {"z": center + RING * length * towards / max(float(np.linalg.norm(towards)), 1e-9)}
    for name, end in {**ends, "center": center}.items():
        pixel = pen.project(end)
        if pixel is not None:
            x, y = pixel
            ui.marks[f"gizmo.{name}"] = (x - MARK, y - MARK, x + MARK, y + MARK)
