"""The graph of a vehicle's speed over time: where it is in the window, and how it is drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from imgui_bundle import ImVec2, imgui

from instdrive_app.panels.widgets.theme import pack_color
from instdrive_app.panels.widgets.ui import Rectangle, Ui, scale_pixels
from instdrive_app.preferences.themes import ACCENT, BACKGROUND, DIM, LINE, TEXT
from instdrive_core.scene.ways.speeds import SpeedPoint, sample_speeds
from instdrive_core.scene.ways.way_keys import Keys

KEY, POINT = 6.0, 4.5
"""Half the width of a key, and the radius of a point; pixels at scale 1."""
LEFT, RIGHT, BELOW, ABOVE = 34.0, 10.0, 30.0, 8.0
"""Margins of the graph in its area, pixels at scale 1."""
SAMPLES = 160
_STEPS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 60.0, 300.0)


@dataclass(frozen=True)
class GraphArea:
    """Where the graph is, and what it shows."""

    place: Rectangle
    first: float
    last: float
    """Seconds at its left and right end."""
    top: float
    """m/s at its upper end; the lower one is 0."""

    @property
    def floor(self) -> float:
        """Height of the line of no speed in the window, pixels."""
        return self.place.y + self.place.height - scale_pixels(BELOW)

    @property
    def key_y(self) -> float:
        """Height of the row of keys in the window, pixels."""
        return self.floor + scale_pixels(KEY + 4)

    def to_x(self, time: float) -> float:
        """Convert seconds to pixels of the window."""
        left, width = self._span()
        return left + (time - self.first) / (self.last - self.first) * width

    def to_time(self, x: float) -> float:
        """Convert pixels of the window to seconds, not beyond the ends."""
        left, width = self._span()
        return self.first + min(max((x - left) / width, 0.0), 1.0) * (self.last - self.first)

    def to_y(self, speed: float) -> float:
        """Convert m/s to pixels of the window."""
        return self.floor - speed / self.top * self._height()

    def to_speed(self, y: float) -> float:
        """Convert pixels of the window to m/s, at least 0."""
        return max((self.floor - y) / self._height() * self.top, 0.0)

    def _span(self) -> tuple[float, float]:
        left = self.place.x + scale_pixels(LEFT)
        return left, max(self.place.width - scale_pixels(LEFT + RIGHT), 1.0)

    def _height(self) -> float:
        return max(self.place.height - scale_pixels(BELOW + ABOVE), 1.0)


def draw_graph(
    ui: Ui, area: GraphArea, keys: Keys, points: tuple[SpeedPoint, ...], held: tuple[str, int] | None
) -> None:
    """Draw axes, the line of the speed, its points, the row of keys, and the present time."""
    draw, chosen = imgui.get_window_draw_list(), ui.session.ways.chosen
    _draw_axes(area)
    now = area.to_x(min(max(ui.session.state.time, area.first), area.last))
    draw.add_line(ImVec2(now, area.place.y), ImVec2(now, area.key_y), pack_color(TEXT, 0.6), scale_pixels(1))
    times = np.linspace(keys[0].time, keys[-1].time, SAMPLES)
    speeds = sample_speeds(keys, times)
    line: list[imgui.ImVec2Like] = [
        ImVec2(area.to_x(time), area.to_y(min(speed, area.top)))
        for time, speed in zip(times.tolist(), speeds.tolist(), strict=True)
    ]
    draw.add_polyline(line, pack_color(ACCENT), scale_pixels(2), imgui.ImDrawFlags_.none)
    for index, point in enumerate(points):
        at = ImVec2(area.to_x(point.time), area.to_y(min(point.speed, area.top)))
        is_held = held == ("point", index)
        draw.add_circle_filled(at, scale_pixels(POINT + 1.5), pack_color(BACKGROUND))
        draw.add_circle_filled(at, scale_pixels(POINT), pack_color(ACCENT if is_held else TEXT))
        ui.mark_spot(f"gizmo.way.speed.{index}", (at.x, at.y), POINT, area.place)
    for index, key in enumerate(keys):
        at = ImVec2(area.to_x(key.time), area.key_y)
        draw_diamond(at, index == chosen)
        ui.mark_spot(f"gizmo.way.key.{index}", (at.x, at.y), KEY, area.place)


def draw_diamond(at: ImVec2, is_chosen: bool) -> None:
    """Draw a key on an axis of time."""
    draw = imgui.get_window_draw_list()
    draw.add_ngon_filled(at, scale_pixels(KEY + 1.5), pack_color(BACKGROUND), 4)
    draw.add_ngon_filled(at, scale_pixels(KEY), pack_color(ACCENT if is_chosen else TEXT), 4)


def _draw_axes(area: GraphArea) -> None:
    """Draw lines at round speeds and times, with their figures."""
    draw, left, right = imgui.get_window_draw_list(), area.to_x(area.first), area.to_x(area.last)
    high = imgui.get_text_line_height()
    pixels = (area.floor - area.to_y(area.top)) / area.top
    step = next((step for step in _STEPS if step * pixels >= 1.6 * high), _STEPS[-1])
    for number in range(int(area.top / step + 1e-6) + 1):
        y, text = area.to_y(number * step), f"{number * step:g}"
        draw.add_line(ImVec2(left, y), ImVec2(right, y), pack_color(LINE), scale_pixels(1))
        wide = imgui.calc_text_size(text).x
        draw.add_text(ImVec2(left - wide - scale_pixels(6), y - high / 2), pack_color(DIM), text)
    draw.add_text(ImVec2(left + scale_pixels(4), area.place.y), pack_color(DIM), "m/s")
    per_second = (right - left) / (area.last - area.first)
    step = next((step for step in _STEPS if step * per_second >= scale_pixels(44)), _STEPS[-1])
    number = int(np.ceil(area.first / step - 1e-6))
    while number * step <= area.last + 1e-6:
        x, text = area.to_x(number * step), f"{number * step:g} s"
        draw.add_line(ImVec2(x, area.place.y), ImVec2(x, area.floor), pack_color(LINE, 0.6), scale_pixels(1))
        wide = imgui.calc_text_size(text).x
        place = min(x + scale_pixels(3), right - wide)
        draw.add_text(ImVec2(place, area.place.y + high), pack_color(DIM), text)
        number += 1
