"""Facts about the selection, and its colour."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.panels.recolor import RecolorControls
from instdrive_app.panels.ui import Ui, command_button, dim_text, swatch
from instdrive_app.theme import ACCENT, DIM, RAISED, packed, rgba
from instdrive_core.edits.document import Document
from instdrive_core.instances.table import Instance


class InspectorPanel:
    """One instance in full, several in sum."""

    def __init__(self) -> None:
        self._recolor = RecolorControls()

    def draw(self, ui: Ui) -> None:
        """One frame."""
        document, ids = ui.session.document, ui.session.selected
        if document is None or not ids:
            imgui.push_text_wrap_pos(0)
            imgui.text_disabled("Click an object in the view to inspect and edit it.")
            imgui.pop_text_wrap_pos()
            return
        if len(ids) == 1:
            _one(ui, document, document.scene.table[ids[0]])
        else:
            _several(ui, document, ids)
        imgui.spacing()
        _section(ui, "Colour")
        self._recolor.draw(ui, ids)


def _one(ui: Ui, document: Document, instance: Instance) -> None:
    _heading(ui, instance.name, instance)
    summary = document.instance_flags(instance.id)
    drawn = f"{summary.drawn:,}" if summary.drawn == summary.count else f"{summary.drawn:,} of {summary.count:,}"
    _fact("Class", instance.class_name or "unknown")
    _fact("Splats", drawn)
    low, high = instance.bounds
    size = [b - a for a, b in zip(low, high, strict=True)]
    _fact("Size", f"{size[0]:.2f} × {size[1]:.2f} × {size[2]:.2f} m")
    if instance.node:
        track = document.scene.actors[instance.node - 1]
        _fact("Moves", f"{track.path_length():.1f} m along its track")
    else:
        center = [(a + b) / 2 for a, b in zip(low, high, strict=True)]
        _fact("Centre", f"{center[0]:.2f}, {center[1]:.2f}, {center[2]:.2f} m")
    if document.scene.code_bits:
        _fact("Codeword", str(instance.codeword))
        _bits(instance.codeword, document.scene.code_bits)


def _several(ui: Ui, document: Document, ids: tuple[int, ...]) -> None:
    _heading(ui, f"{len(ids)} instances", None)
    drawn = sum(document.instance_flags(instance_id).drawn for instance_id in ids)
    classes = sorted({document.scene.table[instance_id].class_name or "unknown" for instance_id in ids})
    _fact("Splats", f"{drawn:,}")
    _fact("Classes", ", ".join(classes))


def _heading(ui: Ui, title: str, instance: Instance | None) -> None:
    if instance is not None:
        swatch(instance)
        imgui.same_line()
    imgui.push_font(ui.fonts.bold, 0.0)
    imgui.text_wrapped(title)
    imgui.pop_font()
    if instance is not None:
        imgui.same_line()
        dim_text(f"#{instance.id}")
    for number, name in enumerate(("edit.delete", "edit.hide", "edit.solo", "view.frame", "edit.rename")):
        if number:
            imgui.same_line()
        command_button(ui, ui.session.commands[name], ImVec2(34, 0))
    imgui.spacing()


def _section(ui: Ui, title: str) -> None:
    imgui.push_font(ui.fonts.bold, 0.0)
    imgui.separator_text(title)
    imgui.pop_font()


def _fact(name: str, value: str) -> None:
    dim_text(name)
    imgui.same_line(imgui.get_font_size() * 5.2)
    imgui.text_wrapped(value)


def _bits(codeword: int, bits: int) -> None:
    """One square per bit of the codebook, the set ones filled, bit 0 at the left."""
    imgui.dummy(ImVec2(0, 0))
    imgui.same_line(imgui.get_font_size() * 5.2)
    at, draw, size = imgui.get_cursor_screen_pos(), imgui.get_window_draw_list(), 9.0
    per_row = max(int(imgui.get_content_region_avail().x / (size + 3)), 1)
    for bit in range(bits):
        x, y = at.x + (bit % per_row) * (size + 3), at.y + (bit // per_row) * (size + 3)
        color = packed(ACCENT) if codeword >> bit & 1 else packed(RAISED)
        draw.add_rect_filled(ImVec2(x, y), ImVec2(x + size, y + size), color, 2)
    imgui.dummy(ImVec2(min(bits, per_row) * (size + 3), (1 + (bits - 1) // per_row) * (size + 3)))
    if imgui.is_item_hovered():
        imgui.begin_tooltip()
        imgui.text("".join(str(codeword >> bit & 1) for bit in range(bits)))
        imgui.text_colored(rgba(DIM), "bit 0 first")
        imgui.end_tooltip()
