"""Preferences: how the editor looks, and its keys."""

from __future__ import annotations

from imgui_bundle import imgui

from instdrive_app.language.languages import CHOICES, LANGUAGES
from instdrive_app.language.translation import make_label, translate
from instdrive_app.panels.dialogs.frame import BUTTON_WIDTH, center_next_window, is_enter_pressed
from instdrive_app.panels.key_list import KeyList
from instdrive_app.panels.widgets.ui import Ui, draw_dim_text, scale_pixels, scale_size
from instdrive_app.preferences.themes import THEMES
from instdrive_app.session.requests import AskPreferences

TITLE = "Preferences"
WIDTH = 560.0
"""Pixels at scale 1."""
LABELS = 150.0


class PreferencesDialog:
    """Shows every choice at work as soon as it is made; all are kept."""

    def __init__(self) -> None:
        self._keys = KeyList()

    def open(self, ui: Ui, request: AskPreferences) -> None:
        """Open it."""
        self._keys = KeyList()
        imgui.open_popup(make_label(TITLE))

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        center_next_window(scale_size(WIDTH, 0))
        if not imgui.begin_popup_modal(make_label(TITLE), None, imgui.WindowFlags_.no_saved_settings)[0]:
            return
        _draw_looks(ui)
        self._keys.draw(ui)
        imgui.spacing()
        imgui.set_cursor_pos_x(
            imgui.get_window_width() - scale_pixels(BUTTON_WIDTH) - imgui.get_style().window_padding.x
        )
        closed = imgui.button(make_label("Close"), scale_size(BUTTON_WIDTH, 0))
        ui.mark("dialog.cancel")
        if closed or (not self._keys.holds_keyboard and (imgui.is_key_pressed(imgui.Key.escape) or is_enter_pressed())):
            imgui.close_current_popup()
        imgui.end_popup()


def _draw_looks(ui: Ui) -> None:
    kept = ui.session.preferences
    draw_dim_text(translate("Theme"))
    for name, theme in THEMES.items():
        imgui.same_line(scale_pixels(LABELS) if name == next(iter(THEMES)) else 0.0)
        if imgui.radio_button(make_label(theme.title), kept.current.theme == name):
            kept.change(theme=name)
        ui.mark(f"preferences.theme.{name}")
    draw_dim_text(translate("Language"))
    for choice in CHOICES:
        imgui.same_line(scale_pixels(LABELS) if choice == CHOICES[0] else 0.0)
        title = LANGUAGES[choice].title if choice in LANGUAGES else translate("As the desktop")
        if imgui.radio_button(f"{title}###language {choice}", kept.current.language == choice):
            kept.change(language=choice)
        ui.mark(f"preferences.language.{choice}")
    draw_dim_text(translate("Instances"))
    imgui.same_line(scale_pixels(LABELS))
    changed, safe = imgui.checkbox(make_label("Colours that colour-blind eyes tell apart"), kept.current.safe_colors)
    ui.mark("preferences.safe_colors")
    if changed:
        kept.change(safe_colors=safe)
    imgui.set_cursor_pos_x(scale_pixels(LABELS))
    imgui.push_text_wrap_pos(0.0)
    draw_dim_text(translate("Only what the window shows: IDs, codewords and exported pictures keep their colours."))
    imgui.pop_text_wrap_pos()
