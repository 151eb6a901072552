"""A number that is dragged live, or typed (double click, or Ctrl + click) and then applied at once."""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple

from imgui_bundle import imgui

from instdrive_app.panels.widgets.gestures import Gesture
from instdrive_app.panels.widgets.ui import Ui


class EnteredNumber(NamedTuple):
    """What the user made of a number."""

    value: float
    gesture: str
    """The same for all values of one drag."""


class NumberField:
    """One widget; it shows the present value, while it is in use what the user makes of it."""

    def __init__(self, name: str, form: str, speed: float, low: float, high: float, hint: str) -> None:
        """`form` is C's, `speed` the change per pixel dragged."""
        self._name, self._form, self._hint = name, form, hint
        self._speed, self._low, self._high = speed, low, high
        self._gesture = Gesture(name)
        self._shown = 0.0
        self.in_use = False
        """Whether it is being dragged or typed into."""

    def draw(self, ui: Ui, present: float, width: float) -> EnteredNumber | None:
        """One frame; returns a value that is to be applied now."""
        if not self.in_use:
            self._shown = present
        imgui.set_next_item_width(width)
        changed, shown = imgui.drag_float(
            f"##{self._name}", self._shown, self._speed, self._low, self._high, self._form
        )
        gesture = self._gesture.name_drag()
        ui.mark(f"inspector.{self._name}")
        if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip) and not imgui.is_item_active():
            imgui.set_tooltip(f"{self._hint}. Drag, or double click to type")
        if changed and isfinite(shown):  # "nan" is read as one
            self._shown = min(max(shown, self._low), self._high)
        self.in_use = imgui.is_item_active()
        dragged = changed and imgui.is_mouse_down(0)  # half-typed numbers wait: on the way to 12.5 lies 1
        if dragged or imgui.is_item_deactivated_after_edit():
            return EnteredNumber(self._shown, gesture)
        return None
