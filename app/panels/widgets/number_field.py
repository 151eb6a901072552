"""A number field: drag to change the value live, or double click (or Ctrl + click) to type one."""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple

from imgui_bundle import imgui

from instdrive_app.language.translation import translate
from instdrive_app.panels.widgets.gestures import Gesture
from instdrive_app.panels.widgets.ui import Ui
from instdrive_core.wording import phrase


class EnteredNumber(NamedTuple):
    """A value that the user entered."""

    value: float
    gesture: str
    """Name of the drag, shared by all its values."""


class NumberField:
    """Shows the present value; while in use, it shows what the user has entered so far."""

    def __init__(self, name: str, form: str, speed: float, low: float, high: float, hint: str) -> None:
        """`form` is a C format; `speed` is the change per pixel dragged."""
        self._name, self._form, self._hint = name, form, hint
        self._speed, self._low, self._high = speed, low, high
        self._gesture = Gesture(name)
        self._shown = 0.0
        self.in_use = False
        """Whether the field is being dragged or typed into."""

    def draw(self, ui: Ui, present: float, width: float) -> EnteredNumber | None:
        """Draw one frame; returns a value that must be applied now, if any."""
        if not self.in_use:
            self._shown = present
        imgui.set_next_item_width(width)
        changed, shown = imgui.drag_float(
            f"##{self._name}", self._shown, self._speed, self._low, self._high, self._form
        )
        gesture = self._gesture.name_drag()
        ui.mark(f"inspector.{self._name}")
        if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip) and not imgui.is_item_active():
            imgui.set_tooltip(translate("{hint}. Drag, or double click to type", hint=phrase(self._hint)))
        if changed and isfinite(shown):  # "nan" is read as one
            self._shown = min(max(shown, self._low), self._high)
        self.in_use = imgui.is_item_active()
        dragged = changed and imgui.is_mouse_down(0)  # typed numbers wait until they are complete
        if dragged or imgui.is_item_deactivated_after_edit():
            return EnteredNumber(self._shown, gesture)
        return None
