"""Asks which instance the selected splats are assigned to."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.language.translation import make_label, translate
from instdrive_app.panels.dialogs.frame import center_next_window, draw_confirm_buttons
from instdrive_app.panels.instances.rows import InstanceRows, Query
from instdrive_app.panels.widgets.ui import Ui, draw_dim_text, draw_fitted_selectable, draw_swatch, get_icon, scale_size
from instdrive_app.session.requests import AskReassign
from instdrive_core.scene.selection import Flag
from instdrive_core.wording import format_count

TITLE = "Reassign the selected splats"
NEW, NONE = -1, 0
"""Targets beside instance IDs: a new instance, and no instance."""


class ReassignDialog:
    """Offers a new instance, no instance, and a searchable list of all instances."""

    def __init__(self) -> None:
        self._rows, self._search, self._target, self._count = InstanceRows(), "", NEW, 0

    def open(self, ui: Ui, request: AskReassign) -> None:
        """Open it with nothing searched for and a new instance proposed."""
        document = ui.session.document
        if document is None:
            return
        self._search, self._target = "", NEW
        self._count = len(document.state.find_rows(Flag.SELECTED))
        imgui.open_popup(make_label(TITLE))

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        center_next_window(scale_size(380, 0))
        if not imgui.begin_popup_modal(make_label(TITLE), None, imgui.WindowFlags_.no_saved_settings)[0]:
            return
        draw_dim_text(translate("{splats} will be assigned to", splats=format_count(self._count, "splat")))
        if imgui.is_window_appearing():
            imgui.set_keyboard_focus_here()
        imgui.set_next_item_width(-1)
        hint = f"{get_icon('ICON_FA_MAGNIFYING_GLASS')}  {translate('Name, class or number')}"
        entered, self._search = imgui.input_text_with_hint(
            "##search", hint, self._search, imgui.InputTextFlags_.enter_returns_true
        )
        ui.mark("reassign.search")
        self._draw_choices(ui)
        # While something is searched for, only what is found can be chosen.
        if draw_confirm_buttons(ui, "Reassign", entered, self._target in self._rows.place or not self._search):
            ui.session.labels.reassign(None if self._target == NEW else self._target)
        imgui.end_popup()

    def _draw_choices(self, ui: Ui) -> None:
        document = ui.session.document
        assert document is not None
        self._rows.update(document, Query(self._search))
        imgui.begin_child("##targets", ImVec2(0, 9 * imgui.get_text_line_height_with_spacing()))
        if not self._search:
            self._draw_choice(ui, NEW, f"{get_icon('ICON_FA_CIRCLE_PLUS')}  {translate('a new instance')}")
            self._draw_choice(ui, NONE, f"{get_icon('ICON_FA_BAN')}  {translate('no instance')}")
        elif self._target not in self._rows.place and self._rows.ids:
            self._target = self._rows.ids[0]
        clipper = imgui.ListClipper()
        clipper.begin(len(self._rows.instances))
        while clipper.step():
            for instance in self._rows.instances[clipper.display_start : clipper.display_end]:
                draw_swatch(ui, instance)
                imgui.same_line()
                about = f"{instance.class_name}, #{instance.id}" if instance.class_name else f"#{instance.id}"
                self._draw_choice(ui, instance.id, f"{instance.name}  ({about})")
        imgui.end_child()

    def _draw_choice(self, ui: Ui, target: int, title: str) -> None:
        flags = imgui.SelectableFlags_.no_auto_close_popups
        if draw_fitted_selectable(title, target, target == self._target, flags):
            self._target = target
        ui.mark(f"reassign.{_MARKS.get(target, target)}")


_MARKS = {NEW: "new", NONE: "none"}
