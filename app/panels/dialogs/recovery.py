"""Offers the work of editors that ended without saving."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.language.translation import make_label, translate
from instdrive_app.panels.dialogs.frame import center_next_window
from instdrive_app.panels.widgets.theme import pop_accent_fill, push_accent_fill, rgba
from instdrive_app.panels.widgets.ui import Ui, draw_dim_text
from instdrive_app.preferences.themes import ERROR
from instdrive_app.session.requests import OfferRecovery
from instdrive_core.project.recoverable import RecoverableSession
from instdrive_core.wording import format_count

TITLE = "Recover unsaved work"


class RecoveryDialog:
    """Shows one row per document, to recover it, discard it, or leave it for later."""

    def open(self, ui: Ui, request: OfferRecovery) -> None:
        """Open it."""
        imgui.open_popup(make_label(TITLE))

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        em = imgui.get_font_size()
        center_next_window(ImVec2(40 * em, 0))
        if not imgui.begin_popup_modal(make_label(TITLE), None, imgui.WindowFlags_.no_saved_settings)[0]:
            return
        imgui.text_wrapped(translate("The editor ended without saving these documents. Their edits were kept."))
        imgui.spacing()
        for number, session in enumerate(list(ui.session.files.autosave.recoverable)):
            imgui.push_id(number)
            self._draw_row(ui, session, number)
            imgui.pop_id()
        imgui.spacing()
        imgui.set_cursor_pos_x(imgui.get_window_width() - 7 * em - imgui.get_style().window_padding.x)
        later = imgui.button(make_label("Later"), ImVec2(7 * em, 0)) or imgui.is_key_pressed(imgui.Key.escape)
        ui.mark("recovery.later")
        if later or not ui.session.files.autosave.recoverable:
            imgui.close_current_popup()
        imgui.end_popup()

    def _draw_row(self, ui: Ui, session: RecoverableSession, number: int) -> None:
        em = imgui.get_font_size()
        imgui.separator()
        imgui.push_font(ui.fonts.bold, 0.0)
        imgui.text(session.title)
        imgui.pop_font()
        buttons = (
            imgui.get_window_width() - 16 * em - imgui.get_style().window_padding.x - imgui.get_style().item_spacing.x
        )
        imgui.same_line(buttons)
        discarded = imgui.button(make_label("Discard"), ImVec2(7 * em, 0))
        ui.mark(f"recovery.{number}.discard")
        imgui.same_line()
        imgui.begin_disabled(bool(session.problem))
        push_accent_fill()
        recovered = imgui.button(make_label("Recover"), ImVec2(9 * em, 0))
        pop_accent_fill()
        imgui.end_disabled()
        ui.mark(f"recovery.{number}.recover")
        changes = format_count(session.edits, "change")
        draw_dim_text(
            translate("{changes}, the last on {day:%Y-%m-%d} at {day:%H:%M}", changes=changes, day=session.changed)
        )
        if session.problem:
            imgui.push_style_color(imgui.Col_.text, rgba(ERROR))
            imgui.text_wrapped(translate(session.problem))
            imgui.pop_style_color()
        else:
            draw_dim_text(str(session.path.parent))
        if discarded:
            ui.session.files.autosave.discard(session)
        if recovered:
            ui.session.files.recover(session)
            imgui.close_current_popup()
