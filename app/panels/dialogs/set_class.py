"""Asks for the class of some instances."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.language.translation import make_label, translate
from instdrive_app.panels.dialogs.frame import center_next_window, draw_confirm_buttons
from instdrive_app.panels.widgets.ui import Ui, draw_fitted_selectable, scale_size
from instdrive_app.session.requests import AskClass

TITLE = "Set class"


class ClassDialog:
    """Offers the scene's classes, and a field to type any other; an empty name means unknown."""

    def __init__(self) -> None:
        self._ids: tuple[int, ...] = ()
        self._text = ""

    def open(self, ui: Ui, request: AskClass) -> None:
        """Open it with the present class, where there is one; not where an undo has taken the instances away."""
        document = ui.session.document
        self._ids = () if document is None else tuple(i for i in request.ids if i in document.scene.table)
        if document is None or not self._ids:
            return
        classes = {document.scene.table[i].class_name for i in self._ids}
        self._text = classes.pop() if len(classes) == 1 else ""
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
        entered, self._text = imgui.input_text_with_hint("##class", translate("unknown"), self._text, flags)
        ui.mark("class.name")
        known = ui.session.labels.list_classes()
        height = min(max(len(known), 1), 8) * imgui.get_text_line_height_with_spacing()
        imgui.begin_child("##known", ImVec2(0, height))
        for name in known:
            flags = imgui.SelectableFlags_.no_auto_close_popups | imgui.SelectableFlags_.allow_double_click
            if draw_fitted_selectable(name, name, name == self._text, flags):
                self._text, entered = name, imgui.is_mouse_double_clicked(0)
            ui.mark(f"class.{name}")
        imgui.end_child()
        if draw_confirm_buttons(ui, "Set", entered, True):
            ui.session.labels.set_class(self._ids, self._text.strip())
        imgui.end_popup()
