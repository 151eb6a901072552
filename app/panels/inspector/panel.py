"""The inspector panel: a heading, buttons, and the sections for the selected instances."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, runtime_checkable

from imgui_bundle import ImVec2, imgui

from instdrive_app.language.translation import make_label, translate
from instdrive_app.panels.inspector.adjust import AdjustSection
from instdrive_app.panels.inspector.facts import FactsSection, TextField
from instdrive_app.panels.inspector.placement import PlacementSection
from instdrive_app.panels.inspector.recolor import RecolorSection
from instdrive_app.panels.widgets.theme import rgba
from instdrive_app.panels.widgets.ui import (
    Ui,
    draw_action_button,
    draw_dim_text,
    get_swatch_color,
    scale_pixels,
    scale_size,
)
from instdrive_app.preferences.themes import PANEL, RAISED
from instdrive_core.edits.document.document import Document
from instdrive_core.instances.table import Instance
from instdrive_core.wording import format_count

BUTTONS = ("edit.delete", "edit.hide", "edit.lock", "edit.solo", "view.frame", "labels.split", "labels.absorb")


@runtime_checkable
class InspectorSection(Protocol):
    """A part of the inspector, one file each; a new one is a file and a line in `SECTIONS`."""

    title: str
    """Title of the line above it, which folds it; empty for no such line."""

    def draw(self, ui: Ui, document: Document, ids: tuple[int, ...]) -> None:
        """Draw one frame for the selected instances, of which there is at least one."""
        ...


SECTIONS: tuple[Callable[[], InspectorSection], ...] = (FactsSection, RecolorSection, PlacementSection, AdjustSection)
"""The sections from top to bottom."""


class InspectorPanel:
    """Shows the selected instances and lets the user change them."""

    def __init__(self) -> None:
        self._name = TextField("name")
        self._sections = tuple(create() for create in SECTIONS)

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        document, ids = ui.session.document, ui.session.selection.ids
        if document is None or not ids:
            imgui.push_text_wrap_pos(0)
            imgui.text_disabled(translate(_advise(ui, document)))
            imgui.pop_text_wrap_pos()
            return
        self._draw_heading(ui, document, ids)
        _draw_buttons(ui)
        for section in self._sections:
            if ui.session.document is not document or ui.session.selection.ids != ids:
                return  # a button above has changed the selection
            if section.title and not _draw_section_header(ui, section.title):
                continue
            imgui.push_id(section.title)
            section.draw(ui, document, ids)
            imgui.pop_id()
            imgui.spacing()

    def _draw_heading(self, ui: Ui, document: Document, ids: tuple[int, ...]) -> None:
        """Draw swatch, name and number; the name is a field that renames the instance."""
        imgui.align_text_to_frame_padding()
        imgui.push_font(ui.fonts.bold, 0.0)
        instance, number = document.scene.table[ids[0]], f"#{ids[0]}"
        if len(ids) > 1:
            imgui.text(translate(format_count(len(ids), "instance")))
            imgui.pop_font()
            return
        _draw_framed_swatch(ui, instance)
        imgui.same_line(0, scale_pixels(2))
        imgui.push_style_color(imgui.Col_.frame_bg, rgba(PANEL))
        name = self._name.draw(
            ui, "inspector.name", instance.name, free=imgui.calc_text_size(number).x + scale_pixels(8)
        )
        imgui.pop_style_color()
        imgui.pop_font()
        if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
            imgui.set_tooltip(translate("{name}\nClick to rename", name=instance.name))
        if name:
            ui.session.labels.rename(instance.id, name)
        imgui.same_line(0, scale_pixels(8))
        imgui.align_text_to_frame_padding()
        draw_dim_text(number)


def _advise(ui: Ui, document: Document | None) -> str:
    if document is None:
        return "Facts about the selected object appear here."
    if not ui.session.selection.is_empty:
        return "The selected splats belong to no instance. Labels › Reassign assigns them to one."
    if not len(document.scene.table):
        return (
            "This scene has no instances to click. Select splats with the rectangle or the lasso; "
            "Labels › New instance turns them into one."
        )
    return "Click an object in the view to inspect and edit it."


def _draw_framed_swatch(ui: Ui, instance: Instance) -> None:
    """Draw a swatch as high as the field beside it, so that what follows on the line keeps its place."""
    size, height, at = imgui.get_text_line_height() * 0.8, imgui.get_frame_height(), imgui.get_cursor_screen_pos()
    top = at.y + (height - size) / 2
    color = imgui.get_color_u32(get_swatch_color(ui, instance))
    imgui.get_window_draw_list().add_rect_filled(
        ImVec2(at.x, top), ImVec2(at.x + size, top + size), color, scale_pixels(3)
    )
    imgui.dummy(ImVec2(size, height))


def _draw_buttons(ui: Ui) -> None:
    for number, name in enumerate(BUTTONS):
        if number:
            imgui.same_line(0, scale_pixels(4))
        draw_action_button(ui, ui.session.actions[name], scale_size(34, 0))
    imgui.spacing()


def _draw_section_header(ui: Ui, title: str) -> bool:
    imgui.push_font(ui.fonts.bold, 0.0)
    imgui.push_style_color(imgui.Col_.header, rgba(RAISED, 0.55))
    imgui.push_style_var(imgui.StyleVar_.frame_padding, scale_size(4, 2))
    shown = imgui.collapsing_header(make_label(title), imgui.TreeNodeFlags_.default_open)
    imgui.pop_style_var()
    imgui.pop_style_color()
    imgui.pop_font()
    ui.mark(f"inspector.{title.lower()}")
    return shown
