"""The selection's position, rotation and scale as numbers to type or drag, and constraints on moves."""

from __future__ import annotations

from dataclasses import replace

from imgui_bundle import imgui

from instdrive_app.actions.move import SWITCHES
from instdrive_app.language.translation import translate
from instdrive_app.panels.inspector.rows import draw_widget_label
from instdrive_app.panels.widgets.number_field import EnteredNumber, NumberField
from instdrive_app.panels.widgets.ui import Ui, draw_action_button, draw_dim_text, scale_pixels, scale_size
from instdrive_app.session.move_controller import Placement
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.move import SCALE_LIMITS
from instdrive_core.wording import phrase

FARTHEST = 1e6
"""Largest number of metres or degrees that can be typed."""
Ids = tuple[int, ...]


class PlacementSection:
    """Applies every number at once; one drag, or one typed number, is one step of the history."""

    title: str = "Placement"

    def __init__(self) -> None:
        self._position = tuple(
            NumberField(
                axis, "%.2f", 0.02, -FARTHEST, FARTHEST, phrase("{axis} of the centre in the world, metres", axis=axis)
            )
            for axis in "xyz"
        )
        yaw = "Rotation about the vertical: moving objects in the world, others since they were trained"
        self._yaw = NumberField("yaw", "%.1f°", 0.5, -FARTHEST, FARTHEST, yaw)
        self._scale = NumberField("scale", "× %.3f", 0.005, *SCALE_LIMITS, "Relative to the trained size")
        self._lane = NumberField("lane", "%+.2f m", 0.02, -FARTHEST, FARTHEST, "Metres to move along the lane")
        self._before: Placement | None = None
        self._in_hand: tuple[object, ...] | None = None

    def draw(self, ui: Ui, document: Document, ids: Ids) -> None:
        """Draw one frame."""
        moving = ui.session.movement
        present = moving.find_placement()
        if self._before is None or not any(field.in_use for field in (*self._position, self._yaw, self._scale)):
            self._before = present  # a drag counts from where it began
        self._draw_position(ui, present)
        draw_widget_label("Yaw, scale")
        half = (imgui.get_content_region_avail().x - imgui.get_style().item_inner_spacing.x) / 2
        entered = self._yaw.draw(ui, present.yaw, half)
        if entered is not None:
            moving.place(self._before, replace(self._before, yaw=entered.value), entered.gesture)
        imgui.same_line(0, imgui.get_style().item_inner_spacing.x)
        entered = self._scale.draw(ui, present.scale, half)
        if entered is not None:
            moving.place(self._before, replace(self._before, scale=entered.value), entered.gesture)
        if moving.options.along_lane:
            draw_widget_label("Along lane")
            entered = self._lane.draw(ui, 0.0, -1)
            if entered is not None:
                moving.shift_along_lane(entered.value, entered.gesture)
        _draw_commands(ui)
        if any(document.scene.table[i].node for i in ids):
            text = "Moves its whole track" if len(ids) == 1 else "Moves the whole tracks of moving objects"
            draw_dim_text(translate(text))
        self._scroll_into_view(ui, ids)

    def _scroll_into_view(self, ui: Ui, ids: Ids) -> None:
        """Scroll the numbers into view when the user is about to move something."""
        moving = ui.session.movement
        in_hand = (ui.tool.operation, moving.options.along_lane, ids) if ui.tool.operation else None
        if in_hand is not None and in_hand != self._in_hand:
            imgui.spacing()  # a line of its own: of the last widgets' line only the upper half would be seen
            imgui.set_scroll_here_y(1.0)
        self._in_hand = in_hand

    def _draw_position(self, ui: Ui, present: Placement) -> None:
        draw_widget_label("Position")
        gap = imgui.get_style().item_inner_spacing.x
        width = (imgui.get_content_region_avail().x - 2 * gap) / 3
        for axis, field in enumerate(self._position):
            if axis:
                imgui.same_line(0, gap)
            entered = field.draw(ui, present.position[axis], width)
            if entered is not None:
                self._move(ui, axis, entered)

    def _move(self, ui: Ui, axis: int, entered: EnteredNumber) -> None:
        assert self._before is not None
        position = list(self._before.position)
        position[axis] = entered.value
        x, y, z = position
        ui.session.movement.place(self._before, replace(self._before, position=(x, y, z)), entered.gesture)


def _draw_commands(ui: Ui) -> None:
    commands = ui.session.actions
    draw_widget_label("Constrain")
    for name in SWITCHES:
        draw_action_button(ui, commands[name], scale_size(34, 0))
        imgui.same_line(0, scale_pixels(4))
    space = imgui.get_content_region_avail().x - scale_pixels(2 * 34 + 4)
    imgui.set_cursor_pos_x(imgui.get_cursor_pos_x() + max(space, 0))
    draw_action_button(ui, commands["move.put_on_ground"], scale_size(34, 0))
    imgui.same_line(0, scale_pixels(4))
    draw_action_button(ui, commands["move.reset"], scale_size(34, 0))
