"""Names for drags, so that one drag of a widget becomes one step of the history."""

from __future__ import annotations

from itertools import count

from imgui_bundle import imgui

_numbers = count()


class Gesture:
    """Names the drags of one widget; each time the widget is grasped, the name changes."""

    def __init__(self, what: str) -> None:
        self._what, self._name = what, ""

    def name_drag(self, pressed: bool = False) -> str:
        """Name the present drag of the widget drawn last; call it right after drawing.

        `pressed` says that a drag begins although the widget cannot tell, because its popup was pressed.
        """
        if pressed or imgui.is_item_activated() or not self._name:
            self._name = f"{self._what} {next(_numbers)}"
        return self._name
