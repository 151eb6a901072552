"""What dialogs share: their place in the window, and the two buttons at the bottom."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.language.translation import make_label, translate
from instdrive_app.panels.widgets.theme import pop_accent_fill, push_accent_fill
from instdrive_app.panels.widgets.ui import Ui, scale_pixels

BUTTON_WIDTH = 92.0
"""Pixels at scale 1."""


def center_next_window(size: ImVec2, always: bool = False) -> None:
    """Place the next window in the middle, never larger than the editor's window; a height of 0 fits its content.

    Without `always` the user can move it. `always` keeps a window centred that changes its size while it is open.
    """
    viewport, edge = imgui.get_main_viewport(), scale_pixels(16)
    most = ImVec2(viewport.size.x - edge, viewport.size.y - edge)
    imgui.set_next_window_pos(
        viewport.get_center(), imgui.Cond_.always if always else imgui.Cond_.appearing, ImVec2(0.5, 0.5)
    )
    imgui.set_next_window_size_constraints(ImVec2(0, 0), most)
    imgui.set_next_window_size(ImVec2(min(size.x, most.x), min(size.y, most.y)))


def is_enter_pressed() -> bool:
    """Whether Enter was pressed in a dialog that was open already, and not while text is typed."""
    keys = (imgui.Key.enter, imgui.Key.keypad_enter)
    typed = imgui.get_io().want_text_input or imgui.is_window_appearing()
    return not typed and any(imgui.is_key_pressed(key, False) for key in keys)


def _is_escape_pressed() -> bool:
    """Whether Escape was pressed and meant for the dialog: a list that is open in it closes first."""
    pressed = imgui.is_key_pressed(imgui.Key.escape, False)  # held over long frames it would close list and dialog
    if pressed and imgui.is_popup_open("", imgui.PopupFlags_.any_popup_id):
        imgui.internal.close_popup_to_level(1, True)
        return False
    return pressed


def draw_confirm_buttons(ui: Ui, title: str, entered: bool, valid: bool, cancel: str = "Cancel") -> bool:
    """Draw the two buttons at the bottom of a dialog; returns whether the user confirmed.

    A button, Escape or Enter closes the dialog. `entered` says that Enter ended a line of text in this frame; Enter
    pressed elsewhere is noticed here.
    """
    entered |= is_enter_pressed()
    imgui.spacing()
    style = imgui.get_style()
    wide = max(imgui.calc_text_size(translate(text)).x for text in (title, cancel)) + 2 * style.frame_padding.x
    width = max(scale_pixels(BUTTON_WIDTH), wide)
    imgui.set_cursor_pos_x(imgui.get_window_width() - 2 * width - style.item_spacing.x - style.window_padding.x)
    cancelled = imgui.button(make_label(cancel), ImVec2(width, 0)) or _is_escape_pressed()
    ui.mark("dialog.cancel")
    imgui.same_line()
    imgui.begin_disabled(not valid)
    push_accent_fill()
    accepted = imgui.button(make_label(title), ImVec2(width, 0))
    pop_accent_fill()
    ui.mark("dialog.accept")
    imgui.end_disabled()
    accepted = valid and (accepted or entered)
    if accepted or cancelled:
        imgui.close_current_popup()
    return accepted
