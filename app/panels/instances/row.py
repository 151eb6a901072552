"""One row of the list of instances: swatch, number, codeword, name, class, count, eye, lock, solo."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from imgui_bundle import ImVec2, imgui

from instdrive_app.language.translation import translate
from instdrive_app.panels.instances.menu import draw_instance_menu
from instdrive_app.panels.widgets.codeword import draw_bit_squares
from instdrive_app.panels.widgets.theme import pack_color, rgba
from instdrive_app.panels.widgets.ui import Ui, draw_swatch, fit_text, get_icon, scale_pixels, scale_size
from instdrive_app.preferences.themes import ACCENT, DIM, TEXT
from instdrive_core.edits.document.document import InstanceSummary
from instdrive_core.instances.table import Instance


class Column(NamedTuple):
    """A column of the list."""

    name: str
    header: str
    width: float
    """Width in font sizes, or a share of the remaining width if the column stretches."""
    stretches: bool = False
    flags: int = 0


BIT_SIZE = 4.0
"""Side of a bit's square, in pixels at scale 1; the gap between two is one pixel."""
_FIXED = imgui.TableColumnFlags_
COLUMNS = (
    Column("Colour", "##colour", 0.8, flags=_FIXED.no_sort | _FIXED.no_resize | _FIXED.no_hide),
    Column("#", "#", 1.9, flags=_FIXED.default_sort | _FIXED.no_hide),
    Column("Code", "Code", 4.0, flags=_FIXED.default_hide),
    Column("Name", "Name", 1.7, stretches=True, flags=_FIXED.no_hide),
    Column("Class", "Class", 1.0, stretches=True),
    Column("Splats", "Splats", 3.2, flags=_FIXED.prefer_sort_descending),
    Column("Shown", "##shown", 1.35, flags=_FIXED.no_resize),
    Column("Locked", "##locked", 1.1, flags=_FIXED.no_resize),
    Column("Solo", "##solo", 1.2, flags=_FIXED.no_resize | _FIXED.no_sort),
)
_PLACE = {column.name: number for number, column in enumerate(COLUMNS)}


class Row(NamedTuple):
    """What a row shows."""

    instance: Instance
    summary: InstanceSummary
    selected: bool
    solo: bool
    code_bits: int


class RowPainter:
    """Draws rows, with a name field in the row that is being renamed."""

    def __init__(self) -> None:
        self.renamed = 0
        """The instance whose name is being typed; 0 for none."""
        self.is_new = False
        """Whether the name field has not been drawn yet."""
        self._name = ""
        self._drawn = False

    def begin(self) -> None:
        """Prepare for the rows of a frame; stop renaming if the row was scrolled away or filtered out."""
        if self.renamed and not self.is_new and not self._drawn:
            self.renamed = 0
        self._drawn = False

    def rename(self, instance: Instance) -> None:
        """Let the user type a name in the instance's row, from the next frame on."""
        self.renamed, self.is_new, self._name = instance.id, True, instance.name

    def draw(self, ui: Ui, row: Row) -> bool:
        """Draw one row of the present table; returns whether it was clicked."""
        instance = row.instance
        imgui.push_id(instance.id)
        imgui.table_next_row()
        imgui.table_set_column_index(_PLACE["Colour"])
        draw_swatch(ui, instance)
        clicked = self._draw_number(ui, row)
        if imgui.table_set_column_index(_PLACE["Code"]) and row.code_bits:
            imgui.set_cursor_pos_y(
                imgui.get_cursor_pos_y() + (imgui.get_text_line_height() - scale_pixels(BIT_SIZE)) / 2
            )
            draw_bit_squares(instance.codeword, row.code_bits, scale_pixels(BIT_SIZE), scale_pixels(1))
        color = rgba(DIM if row.summary.is_hidden or row.summary.is_locked else TEXT)
        imgui.table_set_column_index(_PLACE["Name"])
        if instance.id == self.renamed:
            self._draw_name_field(ui)
        else:
            self._draw_text(instance.name, color)
        if imgui.table_set_column_index(_PLACE["Class"]):
            self._draw_text(instance.class_name, color)
        if imgui.table_set_column_index(_PLACE["Splats"]):
            text = translate("{count:,}", count=row.summary.count - row.summary.deleted)
            free = imgui.get_content_region_avail().x - imgui.calc_text_size(text).x
            imgui.set_cursor_pos_x(imgui.get_cursor_pos_x() + max(free, 0))
            imgui.text_colored(color, text)
        self._draw_switches(ui, row)
        imgui.pop_id()
        return clicked

    def _draw_number(self, ui: Ui, row: Row) -> bool:
        """Draw the number, and make the whole row one item to click, point at and open a menu on."""
        instance, state = row.instance, ui.session.state
        imgui.table_set_column_index(_PLACE["#"])
        if state.hovered == instance.id and not row.selected:
            imgui.table_set_bg_color(imgui.TableBgTarget_.row_bg1, pack_color(ACCENT, 0.09))
        flags = imgui.SelectableFlags_.span_all_columns | imgui.SelectableFlags_.allow_overlap
        clicked = imgui.selectable(str(instance.id), row.selected, flags)[0]
        ui.mark(f"instances.{instance.id}")
        if imgui.is_item_hovered():
            state.hovered = instance.id if row.summary.drawn else 0
            if imgui.is_mouse_double_clicked(0):
                ui.session.navigation.frame((instance.id,))
        if imgui.begin_popup_context_item("##menu"):
            draw_instance_menu(ui, instance.id)
            imgui.end_popup()
        return clicked

    def _draw_text(self, text: str, color) -> None:
        width = imgui.get_content_region_avail().x
        fitted = fit_text(text, width)
        imgui.text_colored(color, fitted)
        if fitted != text and imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
            imgui.set_tooltip(text)

    def _draw_name_field(self, ui: Ui) -> None:
        self._drawn = True
        imgui.set_next_item_width(-1)
        imgui.push_style_var(imgui.StyleVar_.frame_padding, scale_size(3, 0))
        if self.is_new:
            imgui.set_keyboard_focus_here()
        flags = imgui.InputTextFlags_.enter_returns_true | imgui.InputTextFlags_.auto_select_all
        entered, self._name = imgui.input_text("##name", self._name, flags)
        imgui.pop_style_var()
        ui.mark("instances.name")
        cancelled = imgui.is_key_pressed(imgui.Key.escape)
        left = not self.is_new and imgui.is_item_deactivated()
        self.is_new = False
        if entered or left or cancelled:
            name = self._name.strip()
            if name and not cancelled:
                ui.session.labels.rename(self.renamed, name)
            self.renamed = 0

    def _draw_switches(self, ui: Ui, row: Row) -> None:
        session, instance, summary = ui.session, row.instance, row.summary
        ids = (instance.id,)
        imgui.push_style_color(imgui.Col_.button, rgba(DIM, 0.0))
        imgui.push_style_var(imgui.StyleVar_.frame_padding, ImVec2(0, 0))
        hidden, locked = summary.is_hidden, summary.is_locked
        switches: tuple[tuple[str, str, float, bool, str, Callable[[], None]], ...] = (
            (
                "Shown",
                "ICON_FA_EYE_SLASH" if hidden else "ICON_FA_EYE",
                0.6 if hidden else 1.0,
                False,
                "Show" if hidden else "Hide",
                lambda: session.visibility.hide(ids, not hidden),
            ),
            (
                "Locked",
                "ICON_FA_LOCK" if locked else "ICON_FA_LOCK_OPEN",
                1.0 if locked else 0.35,
                locked,
                "Unlock" if locked else "Lock, so that it cannot be selected or edited",
                lambda: session.visibility.lock(ids, not locked),
            ),
            (
                "Solo",
                "ICON_FA_BULLSEYE",
                1.0 if row.solo else 0.35,
                row.solo,
                "Show all again" if row.solo else "Show only this",
                lambda: session.visibility.solo.leave() if row.solo else session.visibility.solo.enter(ids),
            ),
        )
        for column, symbol, weight, on, hint, action in switches:
            if not imgui.table_set_column_index(_PLACE[column]):
                continue
            imgui.push_style_color(imgui.Col_.text, rgba(ACCENT if on else DIM, weight))
            if imgui.button(f"{get_icon(symbol)}##{column}", ImVec2(-1, 0)):
                action()
            imgui.pop_style_color()
            ui.mark(f"instances.{instance.id}.{_MARKS[column]}")
            if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
                imgui.set_tooltip(translate(hint))
        imgui.pop_style_var()
        imgui.pop_style_color()


_MARKS = {"Shown": "eye", "Locked": "lock", "Solo": "solo"}
