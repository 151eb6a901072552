"""The picture in the middle: navigation, pointing, and what is drawn over the splats."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from imgui_bundle import ImVec2, imgui

from instdrive_app import camera
from instdrive_app.panels.instance_menu import instance_menu
from instdrive_app.panels.ui import Ui, icon, swatch
from instdrive_app.pointer import Click
from instdrive_app.render.present_pass import DEPTH_RAMP
from instdrive_app.state import ViewMode, Viewpoint
from instdrive_app.theme import ACCENT, BACKGROUND, DIM, TEXT, packed, rgba

DRAG_PIXELS = 4.0
"""A press that moves further is a drag, not a click."""
TURN_PER_PIXEL = 0.005
FLY_SPEED = 6.0
"""Metres per second; four times that with Shift."""
FLY_KEYS = {
    imgui.Key.w: (0.0, 0.0, 1.0),
    imgui.Key.s: (0.0, 0.0, -1.0),
    imgui.Key.d: (1.0, 0.0, 0.0),
    imgui.Key.a: (-1.0, 0.0, 0.0),
}
LIFT_KEYS = {imgui.Key.e: 1.0, imgui.Key.q: -1.0}


@dataclass
class Rectangle:
    """The picture's place in the window, in pixels."""

    x: float
    y: float
    width: int
    height: int


class ViewportPanel:
    """Shows the document, moves the camera, and hands clicks to the tool."""

    def __init__(self) -> None:
        self._drags = False
        """Whether the present press, or the one just released, was a drag."""
        self._menu_instance = 0

    def draw(self, ui: Ui) -> None:
        """One frame."""
        area, at = imgui.get_content_region_avail(), imgui.get_cursor_screen_pos()
        place = Rectangle(at.x, at.y, max(int(area.x), 16), max(int(area.y), 16))
        ui.marks["viewport"] = (place.x, place.y, place.x + place.width, place.y + place.height)
        if ui.session.document is None:
            _empty_state(ui, place)
            return
        picture = ui.view.show(ui.session.document, ui.session.state, place.width, place.height)
        imgui.image(imgui.ImTextureRef(picture.glo), ImVec2(place.width, place.height))
        imgui.set_cursor_screen_pos(at)
        imgui.set_next_item_allow_overlap()
        buttons = imgui.ButtonFlags_
        all_buttons = buttons.mouse_button_left | buttons.mouse_button_right | buttons.mouse_button_middle
        imgui.invisible_button("##picture", ImVec2(place.width, place.height), all_buttons)
        hovered, active = imgui.is_item_hovered(), imgui.is_item_active()
        self._navigate(ui, place, hovered, active)
        self._point(ui, place, hovered)
        self._context_menu(ui)
        _view_switch(ui, place)
        _camera_tag(ui, place)
        if ui.session.state.view_mode is ViewMode.DEPTH:
            _depth_legend(ui, place)
        elif ui.session.state.view_mode in (ViewMode.INSTANCE, ViewMode.CODEWORD):
            _opacity_slider(ui, place)

    def _navigate(self, ui: Ui, place: Rectangle, hovered: bool, active: bool) -> None:
        state, io = ui.session.state, imgui.get_io()
        viewpoint = state.viewpoint
        if any(imgui.is_mouse_clicked(button) for button in range(3)):
            self._drags = False
        moved = self._dragged_view(ui, place) if active else viewpoint
        if hovered and io.mouse_wheel:
            moved = camera.dolly(moved, 0.88**io.mouse_wheel)
        if (hovered or active) and not io.want_text_input and not io.key_ctrl:
            moved = _flown(moved, io.delta_time, io.key_shift)
        if moved is not viewpoint:
            ui.session.look_from(moved)

    def _dragged_view(self, ui: Ui, place: Rectangle) -> Viewpoint:
        """The viewpoint after this frame's drag: left orbits, right looks around, middle or Shift + left pans."""
        viewpoint, io = ui.session.state.viewpoint, imgui.get_io()
        button = next((b for b in range(3) if imgui.is_mouse_dragging(b, DRAG_PIXELS)), None)
        if button is None:
            return viewpoint
        if not self._drags:
            self._drags = True
            path = imgui.get_mouse_drag_delta(button)
            depth = ui.view.depth_at(io.mouse_pos.x - path.x - place.x, io.mouse_pos.y - path.y - place.y)
            if depth:
                viewpoint = camera.with_pivot(viewpoint, depth)
        dx, dy = io.mouse_delta.x, io.mouse_delta.y
        if not dx and not dy:
            return viewpoint
        if button == 2 or (button == 0 and io.key_shift):
            return camera.pan_pixels(viewpoint, dx, dy, viewpoint.fitted(place.width, place.height).fx)
        turn = camera.look if button == 1 else camera.orbit
        return turn(viewpoint, -dx * TURN_PER_PIXEL, -dy * TURN_PER_PIXEL)

    def _point(self, ui: Ui, place: Rectangle, hovered: bool) -> None:
        io, snapshot = imgui.get_io(), ui.view.snapshot
        x, y = io.mouse_pos.x - place.x, io.mouse_pos.y - place.y
        if ui.script_pointer is not None:
            x, y = ui.script_pointer
        dragging = self._drags and any(imgui.is_mouse_down(button) for button in range(3))
        if snapshot is None or (ui.script_pointer is None and (not hovered or dragging)):
            ui.tool.leave()
            return
        ui.tool.hover(x, y, snapshot)
        if ui.session.state.hovered:
            _hover_label(ui, place, x, y)
        if self._drags or not hovered:
            return
        if imgui.is_mouse_released(0):
            ui.tool.click(Click(x, y, io.key_shift, io.key_ctrl, io.key_alt), snapshot)
        if imgui.is_mouse_released(1) and ui.session.state.hovered:
            self._menu_instance = ui.session.state.hovered
            imgui.open_popup("##picture menu")

    def _context_menu(self, ui: Ui) -> None:
        if imgui.begin_popup("##picture menu"):
            instance_menu(ui, self._menu_instance)
            imgui.end_popup()


def _flown(viewpoint: Viewpoint, seconds: float, fast: bool) -> Viewpoint:
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


def _hover_label(ui: Ui, place: Rectangle, x: float, y: float) -> None:
    document = ui.session.document
    assert document is not None
    instance = document.scene.table[ui.session.state.hovered]
    facts = [instance.class_name] if instance.class_name else []
    facts.append(f"#{instance.id}")
    if document.scene.code_bits:
        facts.append(f"code {instance.codeword}")
    facts.append(f"{document.instance_flags(instance.id).drawn:,} splats")
    text = "  ·  ".join(facts)
    line, gap = imgui.get_text_line_height_with_spacing(), 18.0
    width = max(imgui.calc_text_size(text).x, imgui.calc_text_size(instance.name).x * 1.1 + 2 * line) + 24
    left = min(x + gap, place.width - width - 6)
    top = y + gap if y + gap + 2 * line + 20 < place.height else y - gap - 2 * line - 10
    imgui.set_next_window_pos(ImVec2(place.x + max(left, 6), place.y + max(top, 6)))
    flags = imgui.WindowFlags_
    passive = flags.no_inputs | flags.no_decoration | flags.always_auto_resize | flags.no_saved_settings
    imgui.push_style_color(imgui.Col_.window_bg, rgba(BACKGROUND, 0.92))
    imgui.begin("##hover label", None, passive | flags.no_docking | flags.no_focus_on_appearing | flags.no_nav)
    swatch(instance)
    imgui.same_line()
    imgui.push_font(ui.fonts.bold, 0.0)
    imgui.text(instance.name)
    imgui.pop_font()
    imgui.text_colored(rgba(DIM), text)
    size, corner = imgui.get_window_size(), imgui.get_window_pos()
    ui.marks["hover label"] = (corner.x, corner.y, corner.x + size.x, corner.y + size.y)
    imgui.end()
    imgui.pop_style_color()


def _view_switch(ui: Ui, place: Rectangle) -> None:
    """Four buttons, the present mode highlighted."""
    imgui.set_cursor_screen_pos(ImVec2(place.x + 10, place.y + 10))
    imgui.push_style_var(imgui.StyleVar_.item_spacing, ImVec2(2, 0))
    for mode in ViewMode:
        command = ui.session.commands[f"view.{mode.name.lower()}"]
        on = ui.session.state.view_mode is mode
        imgui.push_style_color(imgui.Col_.button, rgba(ACCENT if on else BACKGROUND, 0.95 if on else 0.78))
        imgui.push_style_color(imgui.Col_.text, rgba(BACKGROUND if on else TEXT))
        if imgui.button(f"{icon(command.icon)}  {mode.value}"):
            command.run()
        imgui.pop_style_color(2)
        ui.mark(command.id)
        if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
            imgui.set_tooltip(f"{mode.value}  ({command.shortcuts[0]})")
        imgui.same_line()
    imgui.pop_style_var()


def _camera_tag(ui: Ui, place: Rectangle) -> None:
    """Through which camera the viewport looks, at the top right."""
    state, document = ui.session.state, ui.session.document
    assert document is not None
    name = "Free camera"
    if state.dataset_view is not None:
        view = document.scene.views[state.dataset_view]
        name = f"{view.name.replace('_', ' ')}  ·  {view.index}"
    text = f"{icon('ICON_FA_VIDEO')}  {name}"
    size = imgui.calc_text_size(text)
    right, top = place.x + place.width - 10, place.y + 10
    draw = imgui.get_window_draw_list()
    draw.add_rect_filled(
        ImVec2(right - size.x - 20, top), ImVec2(right, top + size.y + 10), packed(BACKGROUND, 0.78), 4
    )
    draw.add_text(ImVec2(right - size.x - 10, top + 5), packed(TEXT), text)


def _depth_legend(ui: Ui, place: Rectangle) -> None:
    """The ramp with metres at its ends and in the middle."""
    near, far = ui.view.renderer.depth_range
    width, height = 220.0, 10.0
    left, top = place.x + 16, place.y + place.height - 42
    draw = imgui.get_window_draw_list()
    draw.add_rect_filled(ImVec2(left - 10, top - 8), ImVec2(left + width + 10, top + 34), packed(BACKGROUND, 0.78), 4)
    part = width / (len(DEPTH_RAMP) - 1)
    for number, (first, second) in enumerate(pairwise(DEPTH_RAMP)):
        low, high = ImVec2(left + number * part, top), ImVec2(left + (number + 1) * part, top + height)
        a, b = packed(first), packed(second)
        draw.add_rect_filled_multi_color(low, high, a, b, b, a)
    for place_on_ramp in (0.0, 0.5, 1.0):
        label = f"{near * math.pow(far / near, place_on_ramp):.3g} m"
        shift = imgui.calc_text_size(label).x * place_on_ramp
        draw.add_text(ImVec2(left + width * place_on_ramp - shift, top + height + 3), packed(TEXT), label)


def _opacity_slider(ui: Ui, place: Rectangle) -> None:
    """From which opacity on splats are drawn in the ID views and can be clicked."""
    imgui.set_cursor_screen_pos(ImVec2(place.x + 10, place.y + place.height - imgui.get_frame_height() - 10))
    imgui.set_next_item_width(200)
    imgui.push_style_color(imgui.Col_.frame_bg, rgba(BACKGROUND, 0.85))
    state, form = ui.session.state, "Opacity from %.2f"
    _, state.id_opacity = imgui.slider_float("##id opacity", state.id_opacity, 0.0, 0.95, form)
    imgui.pop_style_color()
    ui.mark("viewport.opacity")
    if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
        imgui.set_tooltip("Fainter splats are left out of this view and cannot be clicked")


def _empty_state(ui: Ui, place: Rectangle) -> None:
    """What to do while nothing is open."""
    job = ui.session.jobs.current
    lines = [job.title + "…"] if job else ["No scene is open", "Ctrl+O opens a .ply file or a run folder"]
    y = place.y + place.height / 2 - 20
    draw = imgui.get_window_draw_list()
    for number, line in enumerate(lines):
        size = imgui.calc_text_size(line)
        draw.add_text(ImVec2(place.x + (place.width - size.x) / 2, y), packed(TEXT if number == 0 else DIM), line)
        y += size.y + 8
