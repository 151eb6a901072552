"""Asks for an instance's new name."""

from __future__ import annotations

from imgui_bundle import imgui

from instdrive_app.language.translation import make_label
from instdrive_app.panels.dialogs.frame import center_next_window, draw_confirm_buttons
from instdrive_app.panels.widgets.ui import Ui, scale_size
from instdrive_app.session.requests import AskName

TITLE = "Rename"


class RenameDialog:
    """Asks for the name of an instance while the list of instances, where names are usually typed, is hidden."""

    def __init__(self) -> None:
        self._instance, self._name = 0, ""

    def open(self, ui: Ui, request: AskName) -> None:
        """Open it with the present name."""
        document = ui.session.document
        self._instance = request.instance
        if document is not None and self._instance in document.scene.table:
            self._name = document.scene.table[self._instance].name
            imgui.open_popup(make_label(TITLE))

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        center_next_window(scale_size(340, 0))
        if not imgui.begin_popup_modal(make_label(TITLE), None, imgui.WindowFlags_.no_saved_settings)[0]:
            return
        if imgui.is_window_appearing():
            imgui.set_keyboard_focus_here()
        imgui.set_next_item_width(-1)
        flags = imgui.InputTextFlags_.enter_returns_true | imgui.InputTextFlags_.auto_select_all
        entered, self._name = imgui.input_text("##name", self._name, flags)
        ui.mark("rename.name")
        if draw_confirm_buttons(ui, "Rename", entered, bool(self._name.strip())):
            ui.session.labels.rename(self._instance, self._name.strip())
        imgui.end_popup()
