"""The keys of the selected thing's way on the timeline, where they are dragged to other times."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.panels.driving.speed_graph import KEY, draw_diamond
from instdrive_app.panels.widgets.ui import Ui, scale_pixels
from instdrive_core.scene.ways.way_keys import Keys, retime_key


class TimelineKeys:
    """Drawn over the slider while the path tool is in the hand; the slider has the mouse everywhere else."""

    def __init__(self) -> None:
        self._start: Keys = ()
        """The keys when the drag began."""

    def draw(self, ui: Ui, left: float, right: float, middle: float) -> None:
        """Draw one frame on a slider that reaches from `left` to `right` (pixels of the window) at this height."""
        ways, timeline = ui.session.ways, ui.session.navigation.timeline
        if not ways.is_active or not ways.drives or timeline.end <= timeline.start:
            return
        per_second = (right - left) / (timeline.end - timeline.start)
        reach, before = scale_pixels(KEY + 2), imgui.get_cursor_screen_pos()
        for index, key in enumerate(ways.keys):
            x = left + (key.time - timeline.start) * per_second
            if not left - 1 <= x <= right + 1:
                continue
            imgui.set_cursor_screen_pos(ImVec2(x - reach, middle - reach))
            imgui.invisible_button(f"##way key {index}", ImVec2(2 * reach, 2 * reach))
            if imgui.is_item_activated():
                ways.choose(index)
                self._start = ways.keys
            if imgui.is_item_active() and imgui.is_mouse_dragging(0, scale_pixels(3)) and index < len(self._start):
                seconds = timeline.start + (imgui.get_io().mouse_pos.x - left) / per_second
                ways.preview(retime_key(self._start, index, seconds))
            if imgui.is_item_deactivated():
                ways.finish()
            draw_diamond(ImVec2(x, middle), index == ways.chosen)
            ui.marks[f"gizmo.timeline.way.{index}"] = (x - reach, middle - reach, x + reach, middle + reach)
        imgui.set_cursor_screen_pos(before)
        imgui.dummy(ImVec2(0, 0))
