"""The About dialog: version, graphics device and log file."""

from __future__ import annotations

from importlib.metadata import version

from imgui_bundle import imgui

from instdrive_app.language.translation import make_label, translate
from instdrive_app.log_file import get_log_path
from instdrive_app.panels.dialogs.frame import BUTTON_WIDTH, center_next_window, is_enter_pressed
from instdrive_app.panels.widgets.ui import Ui, draw_dim_text, make_icon_label, scale_pixels, scale_size
from instdrive_app.session.requests import ShowAbout

TITLE = "InstDrive"


class AboutDialog:
    """Shows what a bug report should mention."""

    def __init__(self) -> None:
        self._copied = False

    def open(self, ui: Ui, request: ShowAbout) -> None:
        """Open it."""
        self._copied = False
        imgui.open_popup(make_label(TITLE))

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        center_next_window(scale_size(480, 0))
        if not imgui.begin_popup_modal(make_label(TITLE), None, imgui.WindowFlags_.no_saved_settings)[0]:
            return
        path = get_log_path()
        for title, fact in (
            ("Version", version("instdrive")),
            ("Drawn by", ui.view.backend),
            ("Log file", str(path)),
        ):
            draw_dim_text(translate(title))
            imgui.same_line(scale_pixels(100))
            imgui.text_wrapped(fact)
        if not path.exists():
            imgui.set_cursor_pos_x(scale_pixels(100))
            draw_dim_text(translate("Nothing has been written to it yet."))
        imgui.spacing()
        if imgui.button(make_icon_label("ICON_FA_COPY", "Copied" if self._copied else "Copy path", "copy path")):
            imgui.set_clipboard_text(str(path))
            self._copied = True
        ui.mark("about.copy")
        imgui.same_line(imgui.get_window_width() - scale_pixels(BUTTON_WIDTH) - imgui.get_style().window_padding.x)
        closed = imgui.button(make_label("Close"), scale_size(BUTTON_WIDTH, 0))
        ui.mark("dialog.cancel")
        if closed or imgui.is_key_pressed(imgui.Key.escape) or is_enter_pressed():
            imgui.close_current_popup()
        imgui.end_popup()
