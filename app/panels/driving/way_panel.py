"""The way of the selected thing in time: its speed as a graph with points to drag, and its keys below."""

from __future__ import annotations

import math

import numpy as np
from imgui_bundle import ImVec2, imgui

from instdrive_app.language.translation import translate
from instdrive_app.panels.driving.speed_graph import GraphArea, draw_graph
from instdrive_app.panels.widgets.ui import (
    Rectangle,
    Ui,
    draw_action_button,
    draw_dim_text,
    fit_text,
    scale_pixels,
    scale_size,
)
from instdrive_core.scene.ways.speeds import SpeedPoint, drive_at_speeds, list_speed_points, move_point, sample_speeds
from instdrive_core.scene.ways.way_keys import Keys, retime_key
from instdrive_core.wording import count_phrase, phrase

BUTTONS = ("way.add", "way.delete", "move.stop", "move.wait", "move.start", "move.slow")
LEAST_TOP = 5.0
"""m/s that the graph shows at least."""
ROOM = 1.3
"""Room above the highest speed."""
REACH = 9.0
"""Pixels at scale 1 around a point or key where the mouse takes it."""
LEAST_HEIGHT = 70.0


class WayPanel:
    """A drag of a point changes the speed, a drag of a key below when the thing is there; a double click adds a key."""

    def __init__(self) -> None:
        self._held: tuple[str, int] | None = None
        """What is dragged, `point` or `key`, and its index."""
        self._start: tuple[Keys, tuple[SpeedPoint, ...]] = ((), ())
        """Keys and speeds when the drag began: each frame starts from them."""
        self._shown: tuple[SpeedPoint, ...] = ()
        self._top = LEAST_TOP

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        session, ways = ui.session, ui.session.ways
        document = session.document
        if document is None or not ways.subject:
            text = "Select something that drives, or a parked thing." if document else "No scene is open."
            imgui.push_text_wrap_pos(0)
            imgui.text_disabled(translate(text))
            imgui.pop_text_wrap_pos()
            return
        for name in BUTTONS:
            draw_action_button(ui, session.actions[name], scale_size(30, 0))
            imgui.same_line()
        imgui.new_line()
        keys = ways.keys
        name = document.scene.table[ways.subject].name
        if not ways.drives:
            self._say(
                phrase("{name} is parked. Take the path tool (Shift+T) and click where it shall drive", name=name)
            )
            return
        count = count_phrase(len(keys), "{count} key on its way", "{count} keys on its way")
        if len(keys) < 2:
            self._say(phrase("{name} stands. Take the path tool (Shift+T) and click where it shall drive", name=name))
            return
        draw_dim_text(fit_text(f"{name}  ·  {translate(count)}", imgui.get_content_region_avail().x))
        self._draw_graph(ui, keys)

    @staticmethod
    def _say(text: str) -> None:
        imgui.push_text_wrap_pos(0)
        draw_dim_text(translate(text))
        imgui.pop_text_wrap_pos()

    def _draw_graph(self, ui: Ui, keys: Keys) -> None:
        at, room = imgui.get_cursor_screen_pos(), imgui.get_content_region_avail()
        place = Rectangle(at.x, at.y, max(int(room.x), 40), max(int(room.y), int(scale_pixels(LEAST_HEIGHT))))
        imgui.invisible_button("##speeds", ImVec2(place.width, place.height))
        ui.mark("way.graph")
        timeline = ui.session.navigation.timeline
        first, last = min(keys[0].time, timeline.start), max(keys[-1].time, timeline.end)
        points = self._shown if self._held is not None and self._held[0] == "point" else list_speed_points(keys)
        if self._held is None:
            speeds = sample_speeds(keys, np.linspace(keys[0].time, keys[-1].time, 200))
            self._top = max(LEAST_TOP, ROOM * max(float(speeds.max()), *(point.speed for point in points)))
        area = GraphArea(place, first, max(last, first + 0.1), self._top)
        self._use_mouse(ui, area, keys, points)
        if self._held is not None and self._held[0] == "point":
            points = self._shown
        elif self._held is not None:
            points = list_speed_points(ui.session.ways.keys)
        draw_graph(ui, area, ui.session.ways.keys, points, self._held)

    def _use_mouse(self, ui: Ui, area: GraphArea, keys: Keys, points: tuple[SpeedPoint, ...]) -> None:
        ways, mouse = ui.session.ways, imgui.get_io().mouse_pos
        if imgui.is_item_activated():
            if imgui.is_mouse_double_clicked(0):
                ways.add(area.to_time(mouse.x))
                return
            self._held = self._find_held(area, keys, points, mouse.x, mouse.y)
            self._start, self._shown = (keys, points), points
            if self._held is None:
                ui.session.navigation.set_time(area.to_time(mouse.x))
            else:
                ways.choose(self._held[1])
        if self._held is not None and imgui.is_item_active() and imgui.is_mouse_dragging(0, scale_pixels(3)):
            self._drag(ui, area, mouse.x, mouse.y)
        elif self._held is None and imgui.is_item_active():
            ui.session.navigation.set_time(area.to_time(mouse.x))
        if imgui.is_item_deactivated() and self._held is not None:
            self._held = None
            ways.finish()

    def _drag(self, ui: Ui, area: GraphArea, x: float, y: float) -> None:
        """Change from what was when the drag began, so that no errors add up."""
        assert self._held is not None
        kind, index = self._held
        keys, points = self._start
        if kind == "key":
            ui.session.ways.preview(retime_key(keys, index, area.to_time(x)))
            return
        self._shown = move_point(points, index, area.to_time(x), area.to_speed(y))
        ui.session.ways.preview(drive_at_speeds(keys, points, self._shown))

    @staticmethod
    def _find_held(
        area: GraphArea, keys: Keys, points: tuple[SpeedPoint, ...], x: float, y: float
    ) -> tuple[str, int] | None:
        """Find the point or key under the mouse; the nearest one."""
        found = [
            (math.hypot(area.to_x(point.time) - x, area.to_y(point.speed) - y), ("point", index))
            for index, point in enumerate(points)
        ]
        found += [
            (math.hypot(area.to_x(key.time) - x, area.key_y - y), ("key", index)) for index, key in enumerate(keys)
        ]
        apart, held = min(found)
        return held if apart <= scale_pixels(REACH) else None
