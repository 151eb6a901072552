"""The camera's path in time: keys to click and drag, a playhead, and what saves the film."""

from __future__ import annotations

import math

from imgui_bundle import ImVec2, imgui

from instdrive_app.language.translation import translate
from instdrive_app.panels.widgets.theme import pack_color
from instdrive_app.panels.widgets.ui import Ui, draw_action_button, draw_dim_text, fit_text, scale_pixels, scale_size
from instdrive_app.preferences.themes import ACCENT, BACKGROUND, DIM, LINE, TEXT
from instdrive_app.session.showing.path_controller import PathController
from instdrive_core.wording import format_count, phrase

HEIGHT, LEAST_HEIGHT, KEY = 34.0, 27.0, 6.0
"""Height of the strip, with more room and with less, and half the width of a key; pixels at scale 1."""
SHORTEST, ROOM, MUCH_ROOM = 10.0, 1.25, 6.0
"""Seconds that the strip shows at least, and how much more than the path it shows at first and at most."""
_STEPS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 60.0, 300.0)
_LABEL_WIDTH = 48.0


class CameraPathPanel:
    """Shows keys on a strip of seconds: a click goes to one, a drag moves it; elsewhere both move the playhead."""

    def __init__(self) -> None:
        self._dragged: int | None = None
        """Index of the key that is held."""
        self._grip = self._pressed = 0.0
        """Pixels from the held key to where it was taken, and where the mouse was pressed."""
        self._has_moved = False
        """Whether the mouse has moved far enough since to be dragging."""
        self._drags = 0
        """Number of drags so far: each is one step to undo."""
        self._span = SHORTEST
        """Seconds that the strip shows; stays as it is while the keys fit in well."""

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        session, path = ui.session, ui.session.camera_path
        if session.document is None:
            imgui.text_disabled(translate("No scene is open."))
            return
        for name in ("path.play", "path.add", "path.replace", "path.delete", "path.film"):
            draw_action_button(ui, session.actions[name], scale_size(30, 0))
            imgui.same_line()
        if len(path.keys) < 2:
            hint = "Look somewhere and add the view, then look elsewhere and add that"
        else:
            hint = phrase(
                "{at:.2f} s of {end:.2f} s   {keys}",
                at=path.playhead,
                end=path.end,
                keys=format_count(len(path.keys), "key"),
            )
        draw_dim_text(fit_text(translate(hint), imgui.get_content_region_avail().x))
        self._draw_strip(ui)

    def _draw_strip(self, ui: Ui) -> None:
        path, at = ui.session.camera_path, imgui.get_cursor_screen_pos()
        room = imgui.get_content_region_avail()
        width, height = max(room.x, 1.0), max(min(room.y, scale_pixels(HEIGHT)), scale_pixels(LEAST_HEIGHT))
        imgui.invisible_button("##strip", ImVec2(width, height))
        ui.mark("path.strip")
        edge = scale_pixels(KEY + 2)
        active, is_released = imgui.is_item_active(), imgui.is_item_deactivated()
        if not (active or is_released) and not path.end <= self._span <= max(SHORTEST, MUCH_ROOM * path.end):
            self._span = max(SHORTEST, path.end * ROOM)
        per_second = max(width - 2 * edge, 1.0) / self._span
        middle, left = at.y + height - edge, at.x + edge
        if imgui.is_item_activated():
            self._press(path, left, per_second)
        if active or is_released:
            self._drag(path, left, per_second)
            per_second = max(width - 2 * edge, 1.0) / self._span
        elif imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
            imgui.set_tooltip(
                translate("Click a key to go there, drag it to change when; click elsewhere to look along the path")
            )
        _draw_ruler(left, at.y, middle, self._span, per_second)
        self._draw_keys(ui, left, middle, per_second)

    def _press(self, path: PathController, left: float, per_second: float) -> None:
        """Take the key under the mouse, if there is one, and look from it."""
        pointed = imgui.get_io().mouse_pos.x
        places = [left + key.at * per_second for key in path.keys]
        nearest = min(range(len(places)), key=lambda index: abs(places[index] - pointed), default=None)
        self._dragged, self._pressed, self._has_moved = None, pointed, False
        path.playing = False
        if nearest is not None and abs(places[nearest] - pointed) <= scale_pixels(KEY + 2):
            self._dragged, self._grip, self._drags = nearest, pointed - places[nearest], self._drags + 1
            path.go_to_key(nearest)

    def _drag(self, path: PathController, left: float, per_second: float) -> None:
        """Let the held key, or else the playhead, follow the mouse; beyond the end more and more is shown."""
        pointed = imgui.get_io().mouse_pos.x
        self._has_moved = self._has_moved or abs(pointed - self._pressed) >= scale_pixels(3)
        grip = 0.0 if self._dragged is None else self._grip
        seconds = max((pointed - grip - left) / per_second, 0.0)
        if seconds > self._span:
            seconds = self._span = self._span * (1 + min(imgui.get_io().delta_time, 0.1))
        if self._dragged is None:
            path.seek(seconds)
        elif self._has_moved:
            self._dragged = path.move(self._dragged, seconds, f"drag {self._drags}")

    def _draw_keys(self, ui: Ui, left: float, middle: float, per_second: float) -> None:
        path, draw = ui.session.camera_path, imgui.get_window_draw_list()
        if path.keys:
            first, last = left + path.keys[0].at * per_second, left + path.end * per_second
            draw.add_line(ImVec2(first, middle), ImVec2(last, middle), pack_color(ACCENT), scale_pixels(2))
        head = left + path.playhead * per_second
        top, low = middle - scale_pixels(10), middle + scale_pixels(9)
        draw.add_line(ImVec2(head, top), ImVec2(head, low), pack_color(TEXT), scale_pixels(1.5))
        for index, key in enumerate(path.keys):
            x, size = left + key.at * per_second, scale_pixels(KEY)
            color = pack_color(ACCENT if index == path.chosen else TEXT)
            draw.add_ngon_filled(ImVec2(x, middle), size + scale_pixels(1.5), pack_color(BACKGROUND), 4)
            draw.add_ngon_filled(ImVec2(x, middle), size, color, 4)
            ui.marks[f"path.strip.{index}"] = (x - size, middle - size, x + size, middle + size)


def _draw_ruler(left: float, top: float, middle: float, span: float, per_second: float) -> None:
    draw, label = imgui.get_window_draw_list(), scale_pixels(_LABEL_WIDTH)
    step = next((step for step in _STEPS if step * per_second >= label), _STEPS[-1])
    draw.add_line(ImVec2(left, middle), ImVec2(left + span * per_second, middle), pack_color(LINE), scale_pixels(2))
    for number in range(math.floor(span / step + 1e-6) + 1):
        x, text = left + number * step * per_second, f"{number * step:g} s"
        draw.add_line(ImVec2(x, middle - scale_pixels(4)), ImVec2(x, middle), pack_color(LINE), scale_pixels(1))
        wide = imgui.calc_text_size(text).x
        place = max(left - scale_pixels(KEY), min(x - wide / 2, left + span * per_second - wide))
        draw.add_text(ImVec2(place, top), pack_color(DIM), text)
