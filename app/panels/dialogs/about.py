"""What version this is, what draws it, and where its log is."""

from __future__ import annotations

from importlib.metadata import version

from imgui_bundle import imgui

from instdrive_app.log_file import get_log_path
from instdrive_app.panels.dialogs.frame import BUTTON_WIDTH, centered, enter_pressed
from instdrive_app.panels.widgets.ui import Ui, dim_text, icon, scaled, scaled_size

TITLE = "InstDrive"


class AboutDialog:
    """Facts to copy into a report."""

    names: tuple[str, ...] = ("about",)

    def __init__(self) -> None:
        self._copied = False

    def ask(self, ui: Ui, name: str) -> None:
        """Open it."""
        self._copied = False
        imgui.open_popup(TITLE)

    def draw(self, ui: Ui) -> None:
        """One frame."""
        centered(scaled_size(480, 0))
        if not imgui.begin_popup_modal(TITLE, None, imgui.WindowFlags_.no_saved_settings)[0]:
            return
        path = get_log_path()
        for title, fact in (
            ("Version", version("instdrive")),
            ("Pictures by", ui.view.backend),
            ("Log file", str(path)),
        ):
            dim_text(title)
            imgui.same_line(scaled(100))
            imgui.text_wrapped(fact)
        if not path.exists():
            imgui.set_cursor_pos_x(scaled(100))
            dim_text("Nothing has been written to it yet.")
        imgui.spacing()
        if imgui.button(f"{icon('ICON_FA_COPY')}  {'Copied' if self._copied else 'Copy path'}"):
            imgui.set_clipboard_text(str(path))
            self._copied = True
        ui.mark("about.copy")
        imgui.same_line(imgui.get_window_width() - scaled(BUTTON_WIDTH) - imgui.get_style().window_padding.x)
        closed = imgui.button("Close", scaled_size(BUTTON_WIDTH, 0))
        ui.mark("dialog.cancel")
        if closed or imgui.is_key_pressed(imgui.Key.escape) or enter_pressed():
            imgui.close_current_popup()
        imgui.end_popup()
