"""Every text that is handed to ImGui while something else runs."""

from collections.abc import Callable

from imgui_bundle import imgui

SHOWN = {"text_colored": 1, "input_text_with_hint": 1, "begin_combo": 1} | dict.fromkeys(
    (
        *("text", "text_wrapped", "text_disabled", "set_tooltip", "set_item_tooltip", "separator_text", "button"),
        *("small_button", "checkbox", "radio_button", "selectable", "menu_item", "begin_menu", "begin_popup_modal"),
        *("collapsing_header", "table_setup_column", "input_float", "input_int", "calc_text_size"),
    ),
    0,
)
"""Functions of ImGui, and which of their arguments the user reads."""
_BLANKS = " …" + "".join(map(chr, range(0xE000, 0xF900)))
"""What stands around words: spaces, dots and icons."""


def record_texts() -> set[str]:
    """Replace ImGui's functions for the rest of the process by ones that note what they draw; returns the notes."""
    seen: set[str] = set()
    for name, place in SHOWN.items():
        setattr(imgui, name, _listen(getattr(imgui, name), place, seen))
    return seen


def _listen(draw: Callable, place: int, seen: set[str]) -> Callable:
    def listening(*arguments, **named):
        if len(arguments) > place and isinstance(arguments[place], str):
            seen.add(strip_frame(arguments[place].split("##")[0]))
        return draw(*arguments, **named)

    return listening


def strip_frame(text: str) -> str:
    """The words of a label, without icon and dots."""
    return text.strip(_BLANKS)
