"""One drag of a widget is one step of the history."""

from __future__ import annotations

from itertools import count

from imgui_bundle import imgui

_numbers = count()


class Gesture:
    """Names the drags of one widget; a new name each time the widget is taken up."""

    def __init__(self, what: str) -> None:
        self._what, self._name = what, ""

    def name_drag(self, pressed: bool = False) -> str:
        """The name of the drag that the last widget is in; to be asked right after the widget is drawn.

        `pressed` says that a drag begins also where the widget cannot tell (its popup was pressed).
        """
        if pressed or imgui.is_item_activated() or not self._name:
            self._name = f"{self._what} {next(_numbers)}"
        return self._name
