"""Asking for an instance's new name."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.panels.dialogs.frame import centered, confirmed
from instdrive_app.panels.ui import Ui

TITLE = "Rename"


class RenameDialog:
    """Renames `session.renamed`."""

    names: tuple[str, ...] = ("rename",)

    def __init__(self) -> None:
        self._name = ""

    def ask(self, ui: Ui, name: str) -> None:
        """Open it with the present name."""
        assert ui.session.document is not None
        self._name = ui.session.document.scene.table[ui.session.renamed].name
        imgui.open_popup(TITLE)

    def draw(self, ui: Ui) -> None:
        """One frame."""
        centered(ImVec2(340, 0))
        if not imgui.begin_popup_modal(TITLE, None, imgui.WindowFlags_.no_saved_settings)[0]:
            return
        if imgui.is_window_appearing():
            imgui.set_keyboard_focus_here()
        imgui.set_next_item_width(-1)
        flags = imgui.InputTextFlags_.enter_returns_true | imgui.InputTextFlags_.auto_select_all
        entered, self._name = imgui.input_text("##name", self._name, flags)
        ui.mark("rename.name")
        if confirmed(ui, "Rename", entered, bool(self._name.strip())):
            ui.session.rename(ui.session.renamed, self._name.strip())
        imgui.end_popup()
