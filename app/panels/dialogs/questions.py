"""Modal questions with a button for each answer."""

from __future__ import annotations

from collections.abc import Callable

from imgui_bundle import ImVec2, imgui

from instdrive_app.language.translation import make_label, translate
from instdrive_app.panels.dialogs.frame import center_next_window, is_enter_pressed
from instdrive_app.panels.widgets.theme import pop_accent_fill, push_accent_fill
from instdrive_app.panels.widgets.ui import Ui

Answers = dict[str, Callable[[], None]]
"""Title of each button and what it does. The first answers Escape; the last is highlighted and answers Enter."""


def draw_question(ui: Ui, title: str, text: str, answers: Answers) -> None:
    """Draw a question while its popup is open; an answer closes the popup. Marks: ``question.TITLE OF BUTTON``."""
    em = imgui.get_font_size()
    center_next_window(ImVec2(30 * em, 0))
    if not imgui.begin_popup_modal(make_label(title), None, imgui.WindowFlags_.no_saved_settings)[0]:
        return
    imgui.text_wrapped(translate(text))
    imgui.spacing()
    gap = imgui.get_style().item_spacing.x
    widths = [imgui.calc_text_size(translate(name)).x + 2.2 * em for name in answers]
    imgui.set_cursor_pos_x(
        imgui.get_window_width() - sum(widths) - gap * (len(widths) - 1) - imgui.get_style().window_padding.x
    )
    names = list(answers)
    for name, width in zip(names, widths, strict=True):
        proposed = name == names[-1]
        if proposed:
            push_accent_fill()
        pressed = imgui.button(make_label(name), ImVec2(width, 0))
        ui.mark(f"question.{name}")
        if proposed:
            pop_accent_fill()
        pressed |= proposed and is_enter_pressed()
        pressed |= name == names[0] and imgui.is_key_pressed(imgui.Key.escape)
        if pressed:
            imgui.close_current_popup()
            answers[name]()
            break
        imgui.same_line()
    imgui.new_line()
    imgui.end_popup()
