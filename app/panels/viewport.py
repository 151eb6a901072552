"""The viewport: the picture of the scene, camera navigation, pointing, and overlays."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from imgui_bundle import ImVec2, imgui

from instdrive_app import camera
from instdrive_app.actions.conditions import ask_to_wait
from instdrive_app.panels.empty_view import EmptyView
from instdrive_app.panels.instances.menu import draw_instance_menu
from instdrive_app.panels.opening_banner import draw_opening_banner
from instdrive_app.panels.overlays.reference import draw_reference_beside, split_viewport
from instdrive_app.panels.overlays.registry import ABOVE_HANDLES, BELOW_HANDLES, HANDLES
from instdrive_app.panels.views import keep_thumbnails
from instdrive_app.panels.widgets.ui import Rectangle, Ui, scale_pixels
from instdrive_app.pointer import Click, Point
from instdrive_app.preferences.key_presets import LEFT, PRESETS, CameraDrag
from instdrive_app.session.files.sketches import Sketch
from instdrive_app.state import FrameSnapshot, Viewpoint

PICTURE = "##picture"
"""ID of the picture as an ImGui item."""
DRAG_PIXELS = 4.0
"""A press that moves farther than this is a drag, not a click; pixels at scale 1."""
QUICK_FRAMES, QUICK_PIXELS = 2, 6.0
"""Frames within which a second press is one of a double click however long they last, and its distance, pixels."""
TURN_PER_PIXEL = 0.005
"""Radians per pixel at scale 1."""
DOLLY_PER_PIXEL = 0.99
"""Share of the distance to the pivot that is left after a drag by a pixel at scale 1, up or to the right."""
FLY_SPEED = 6.0
"""Metres per second; four times as fast with Shift."""
FLY_KEYS = {
    imgui.Key.w: (0.0, 0.0, 1.0),
    imgui.Key.s: (0.0, 0.0, -1.0),
    imgui.Key.d: (1.0, 0.0, 0.0),
    imgui.Key.a: (-1.0, 0.0, 0.0),
}
LIFT_KEYS = {imgui.Key.e: 1.0, imgui.Key.q: -1.0}


@dataclass(frozen=True)
class Press:
    """A press of a mouse button."""

    frame: int
    """Number of the frame in which it was heard of."""
    x: float
    y: float


def is_quick_repeat(before: Press, now: Press) -> bool:
    """Whether a press follows another as fast as frames can tell, at the same place.

    Where frames last long, both presses of a double click are heard of too far apart for its time. What was meant to
    frame a car would then select the road behind it.
    """
    return now.frame - before.frame <= QUICK_FRAMES and math.hypot(now.x - before.x, now.y - before.y) <= QUICK_PIXELS


class ViewportPanel:
    """Shows the document, moves the camera, and passes clicks and drags to the current tool."""

    def __init__(self) -> None:
        self._below, self._above = (
            tuple(record.create() for record in records) for records in (BELOW_HANDLES, ABOVE_HANDLES)
        )
        self._handles = HANDLES.create()
        self._drags = False
        """Whether the present press, or the one just released, was a drag."""
        self._tool_drags = False
        self._tool_stopped = False
        """Whether Escape ended the tool's part of the present press."""
        self._is_double = False
        """Whether the present press, or the one just released, is the second of a double click."""
        self._press = Press(-100, 0.0, 0.0)
        self._menu_instance = 0
        self._empty = EmptyView()

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        area, at = imgui.get_content_region_avail(), imgui.get_cursor_screen_pos()
        density = max(imgui.get_io().display_framebuffer_scale.x, 1.0)
        place = Rectangle(at.x, at.y, max(int(area.x), 16), max(int(area.y), 16), density)
        ui.marks["viewport"] = (place.x, place.y, place.x + place.width, place.y + place.height)
        if ui.session.sketches.shown is not None:
            self._draw_sketch(ui, place, ui.session.sketches.shown)
            return
        if ui.session.document is None:
            ui.sketch_view.release()
            self._empty.draw(ui, place)
            return
        place, beside = split_viewport(ui, place)
        if beside is not None:
            draw_reference_beside(ui, beside)
            at = ImVec2(place.x, place.y)
            imgui.set_cursor_screen_pos(at)
        ui.marks["picture"] = (place.x, place.y, place.x + place.width, place.y + place.height)
        ui.session.state.picture_size = place.picture_size
        ui.session.state.pixel_scale = scale_pixels(density)
        picture = ui.view.show(ui.session.document, ui.session.state, *place.picture_size)
        if ui.view.snapshot is None and ui.sketch_view.document is not None:
            # Until the first picture of what was sketched is there.
            picture = ui.sketch_view.show(ui.sketch_view.document, ui.session.state, *place.picture_size)
        else:
            ui.sketch_view.release()
        keep_thumbnails(ui)
        imgui.image(imgui.ImTextureRef(picture.glo), ImVec2(place.width, place.height))
        imgui.set_cursor_screen_pos(at)
        layers = imgui.get_window_draw_list()
        layers.channels_split(2)
        layers.channels_set_current(1)
        self._offer_handles(ui, place)
        layers.channels_set_current(0)
        hovered, active = self._add_picture_button(place)
        self._navigate(ui, place, hovered, active)
        self._update_pointer(ui, place, hovered)
        self._draw_context_menu(ui)
        for overlay in self._below:
            overlay.draw(ui, place)
        layers.channels_merge()
        for overlay in self._above:
            overlay.draw(ui, place)

    def _draw_sketch(self, ui: Ui, place: Rectangle, sketch: Sketch) -> None:
        """Draw what is known of a scene that is being opened; the camera moves, and clicks are asked to wait."""
        ui.marks["picture"] = (place.x, place.y, place.x + place.width, place.y + place.height)
        ui.session.state.picture_size = place.picture_size
        ui.session.state.pixel_scale = scale_pixels(place.density)
        ui.pointer, ui.session.state.hovered = None, 0
        at = imgui.get_cursor_screen_pos()
        picture = ui.sketch_view.show(sketch.document, ui.session.state, *place.picture_size)
        imgui.image(imgui.ImTextureRef(picture.glo), ImVec2(place.width, place.height))
        imgui.set_cursor_screen_pos(at)
        hovered, active = self._add_picture_button(place)
        self._navigate(ui, place, hovered, active)
        if hovered and not self._drags and (imgui.is_mouse_released(0) or imgui.is_mouse_released(1)):
            ask_to_wait(ui.session)
        draw_opening_banner(ui, place, sketch.job)

    def _offer_handles(self, ui: Ui, place: Rectangle) -> None:
        """Draw the handles before the picture's own item, so that they get the mouse first.

        Handles ignore a press if the mouse was over an item in the frame before. The picture must not count as one.
        """
        context = imgui.get_current_context()
        hovered_before = context.hovered_id_previous_frame
        if hovered_before == imgui.get_id(PICTURE):
            context.hovered_id_previous_frame = 0
        self._handles.draw(ui, place)
        context.hovered_id_previous_frame = hovered_before

    def _add_picture_button(self, place: Rectangle) -> tuple[bool, bool]:
        """Make the picture an ImGui item, unless the handles have the mouse; returns whether hovered and active."""
        imgui.set_next_item_allow_overlap()
        if self._handles.holds_mouse:
            imgui.dummy(ImVec2(place.width, place.height))
            return False, False
        buttons = imgui.ButtonFlags_
        all_buttons = buttons.mouse_button_left | buttons.mouse_button_right | buttons.mouse_button_middle
        imgui.invisible_button(PICTURE, ImVec2(place.width, place.height), all_buttons)
        if imgui.is_item_hovered() and any(imgui.is_mouse_clicked(button) for button in range(3)):
            imgui.set_window_focus()  # also where the press comes with the mouse, before ImGui knows what is below it
        return imgui.is_item_hovered(), imgui.is_item_active()

    def _navigate(self, ui: Ui, place: Rectangle, hovered: bool, active: bool) -> None:
        state, io = ui.session.state, imgui.get_io()
        viewpoint = state.viewpoint
        if any(imgui.is_mouse_clicked(button) for button in range(3)):
            self._drags = self._tool_stopped = False
            press = Press(imgui.get_frame_count(), io.mouse_pos.x, io.mouse_pos.y)
            repeats = imgui.is_mouse_clicked(0) and is_quick_repeat(self._press, press)
            self._is_double, self._press = repeats or imgui.is_mouse_double_clicked(0), press
        moved = self._drag_view(ui, place) if active else viewpoint
        if hovered and io.mouse_wheel and io.key_alt and ui.session.sketches.shown is None:
            self._turn_wheel(ui, place, -1 if io.mouse_wheel > 0 else 1)
        elif hovered and io.mouse_wheel:
            moved = camera.dolly(moved, 0.88**io.mouse_wheel)
        flies = PRESETS[ui.session.preferences.current.preset].flies_always or imgui.is_mouse_down(1)
        if (hovered or active) and flies and not io.want_text_input and not io.key_ctrl:
            moved = _fly(moved, io.delta_time, io.key_shift)
        if moved is not viewpoint:
            ui.session.navigation.look_from(moved)

    def _drag_view(self, ui: Ui, place: Rectangle) -> Viewpoint:
        """The viewpoint after this frame's drag, by the gestures of the preset that the user prefers.

        With a tool that uses the left button, the right button orbits where it else looks around.
        """
        viewpoint, io = ui.session.state.viewpoint, imgui.get_io()
        button = next((b for b in range(3) if imgui.is_mouse_dragging(b, scale_pixels(DRAG_PIXELS))), None)
        if button is None:
            return viewpoint
        path = imgui.get_mouse_drag_delta(button)
        start = place.find_pixel(io.mouse_pos.x - path.x, io.mouse_pos.y - path.y)
        first, self._drags = not self._drags, True
        preset = PRESETS[ui.session.preferences.current.preset]
        is_alt_orbit = io.key_alt and CameraDrag(LEFT, "orbit", "Alt") in preset.drags
        uses_tool = ui.tool.drags and ui.session.sketches.shown is None
        if button == 0 and uses_tool and not is_alt_orbit:
            self._drag_tool(ui, start, place.find_pixel(io.mouse_pos.x, io.mouse_pos.y))
            return viewpoint
        if first:
            view = ui.view if ui.session.sketches.shown is None else ui.sketch_view
            depth = view.measure_depth_at(*start)
            if depth:
                viewpoint = camera.set_pivot_distance(viewpoint, depth)
        dx, dy = io.mouse_delta.x, io.mouse_delta.y
        if not dx and not dy:
            return viewpoint
        motion = preset.find_motion(button, io.key_shift, io.key_ctrl, io.key_alt)
        if motion is None:
            return viewpoint
        if motion == "pan":
            return camera.pan_pixels(viewpoint, dx, dy, viewpoint.fit_camera(place.width, place.height).fx)
        if motion == "dolly":
            return camera.dolly(viewpoint, DOLLY_PER_PIXEL ** ((dx - dy) / scale_pixels(1)))
        turn = camera.look if motion == "look" and not uses_tool else ui.session.navigation.orbit
        return turn(viewpoint, -dx * TURN_PER_PIXEL / scale_pixels(1), -dy * TURN_PER_PIXEL / scale_pixels(1))

    def _turn_wheel(self, ui: Ui, place: Rectangle, step: int) -> None:
        """Go to what is behind, or back to what is before it, under the pointer."""
        at, snapshot = imgui.get_io().mouse_pos, ui.view.snapshot
        if snapshot is not None:
            ui.tool.cycle(Click(*place.find_pixel(at.x, at.y)), snapshot, step)

    def _drag_tool(self, ui: Ui, start: Point, to: Point) -> None:
        if imgui.is_key_pressed(imgui.Key.escape):
            ui.tool.cancel()
            self._tool_drags, self._tool_stopped = False, True
        if not self._tool_stopped:
            self._tool_drags = True
            ui.tool.drag(start, to)

    def _update_pointer(self, ui: Ui, place: Rectangle, hovered: bool) -> None:
        io, snapshot = imgui.get_io(), ui.view.snapshot
        x, y = place.find_pixel(io.mouse_pos.x, io.mouse_pos.y)
        if ui.script_pointer is not None:
            x, y = ui.script_pointer
        ui.pointer, ui.session.state.hovered_camera = None, None
        click = Click(x, y, io.key_shift, io.key_ctrl, io.key_alt, self._is_double)
        if self._tool_drags and not imgui.is_mouse_down(0):
            self._tool_drags = False
            if snapshot is not None:
                ui.tool.release(click, snapshot)
            ui.tool.cancel()
        if ui.tool.outline and not self._tool_drags and snapshot is not None:
            _close_outline(ui, click, snapshot)
        dragging = self._drags and any(imgui.is_mouse_down(button) for button in range(3))
        if snapshot is None or (ui.script_pointer is None and (not hovered or dragging)):
            ui.tool.leave()
            return
        ui.pointer = (x, y)
        if self._point_at_camera(ui, snapshot, x, y, hovered):
            return
        ui.tool.hover(x, y, snapshot)
        if self._drags or not hovered:
            return
        if imgui.is_mouse_released(0) and ui.session.colors.picks_reference:
            row = ui.view.find_row_at(x, y)
            if row is not None:
                ui.session.colors.take_reference_from(row)
        elif imgui.is_mouse_released(0):
            ui.tool.click(click, snapshot)
        if imgui.is_mouse_released(1) and ui.session.state.hovered:
            self._menu_instance = ui.session.state.hovered
            imgui.open_popup("##picture menu")

    def _point_at_camera(self, ui: Ui, snapshot: FrameSnapshot, x: float, y: float, hovered: bool) -> bool:
        """Hover the drawn camera that is here, and look through it at a click; returns whether there is one.

        Tools that take the left button for something else are left alone.
        """
        state = ui.session.state
        if not state.show_cameras or not (state.tool == "pick" or ui.tool.operation):
            return False
        state.hovered_camera = ui.session.cameras.find_at(snapshot.camera, x, y)
        if state.hovered_camera is None:
            return False
        ui.tool.leave()
        if imgui.is_mouse_released(0) and hovered and not self._drags:
            ui.session.navigation.look_through(state.hovered_camera)
        return True

    def _draw_context_menu(self, ui: Ui) -> None:
        if imgui.begin_popup("##picture menu"):
            draw_instance_menu(ui, self._menu_instance)
            imgui.end_popup()


def _close_outline(ui: Ui, click: Click, snapshot: FrameSnapshot) -> None:
    """Close an outline that is set corner by corner at Enter, and give it up at Escape."""
    if imgui.is_key_pressed(imgui.Key.escape, False):
        ui.tool.cancel()
    elif imgui.is_key_pressed(imgui.Key.enter, False) or imgui.is_key_pressed(imgui.Key.keypad_enter, False):
        ui.tool.release(click, snapshot)


def _fly(viewpoint: Viewpoint, seconds: float, fast: bool) -> Viewpoint:
    step, up = np.zeros(3), 0.0
    for key, direction in FLY_KEYS.items():
        if imgui.is_key_down(key):
            step += direction
    for key, direction in LIFT_KEYS.items():
        if imgui.is_key_down(key):
            up += direction
    if not step.any() and not up:
        return viewpoint
    distance = FLY_SPEED * (4 if fast else 1) * min(seconds, 0.1)
    return camera.lift(camera.fly(viewpoint, step * distance), up * distance)
