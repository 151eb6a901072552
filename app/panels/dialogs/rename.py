"""Asking for an instance's new name."""

from __future__ import annotations

from imgui_bundle import imgui

from instdrive_app.panels.dialogs.frame import center_next_window, draw_confirm_buttons
from instdrive_app.panels.widgets.ui import Ui, scale_size

TITLE = "Rename"


PATIENCE_FRAMES = 2
"""Frames in which the list of instances, where it is on screen, takes up `session.renamed`."""


class RenameDialog:
    """Asks for the name of `session.renamed` where the list, in which names are typed otherwise, is not on screen."""

    names: tuple[str, ...] = ("rename",)

    def __init__(self) -> None:
        self._instance, self._name = 0, ""
        self._frames = 0

    def ask(self, ui: Ui, name: str) -> None:
        """Open it with the present name."""
        document = ui.session.document
        self._instance, ui.session.renamed = ui.session.renamed, 0
        if document is not None and self._instance in document.scene.table:
            self._name = document.scene.table[self._instance].name
            imgui.open_popup(TITLE)

    def draw(self, ui: Ui) -> None:
        """One frame."""
        self._frames = self._frames + 1 if ui.session.renamed else 0
        if self._frames > PATIENCE_FRAMES:
            self.ask(ui, "rename")
        center_next_window(scale_size(340, 0))
        if not imgui.begin_popup_modal(TITLE, None, imgui.WindowFlags_.no_saved_settings)[0]:
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
