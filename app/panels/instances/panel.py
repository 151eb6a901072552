"""The list of instances, in step with the view: selected, hovered, hidden, locked or shown alone."""

from __future__ import annotations

from dataclasses import replace

from imgui_bundle import ImVec2, imgui

from instdrive_app.language.translation import make_label, translate
from instdrive_app.panels.instances.list_walk import Step, Walk
from instdrive_app.panels.instances.row import BIT_SIZE, COLUMNS, Row, RowPainter
from instdrive_app.panels.instances.rows import InstanceRows, Query
from instdrive_app.panels.instances.seen_moving import SeenMovingList
from instdrive_app.panels.widgets.theme import pop_accent_fill, push_accent_fill, rgba
from instdrive_app.panels.widgets.ui import Ui, get_icon, scale_pixels, scale_size
from instdrive_app.preferences.themes import ACCENT, DIM
from instdrive_app.session.requests import AskName
from instdrive_core.edits.document.document import Document
from instdrive_core.wording import format_count, phrase

WALKING: dict[imgui.Key, Step] = {
    imgui.Key.up_arrow: "up",
    imgui.Key.down_arrow: "down",
    imgui.Key.home: "first",
    imgui.Key.end: "last",
}
"""Keys that walk through the focused list; in the search field only the first two do."""
OWN_SHORTCUTS = frozenset({"Home", "Shift+Home", "Enter"})
"""Shortcuts of actions that mean something else while the list is focused."""
UNKNOWN = "unknown"
"""Name shown for instances without a class."""


class InstancesPanel:
    """Searches, filters and sorts instances; selects (Shift: a range, Ctrl: one more), hides, locks, solos, renames."""

    def __init__(self) -> None:
        self._rows, self._query = InstanceRows(), Query()
        self._painter = RowPainter()
        self._seen_moving = SeenMovingList()
        self._shows_codes, self._flips_codes = False, False
        self._walk, self._scroll_to = Walk(), 0
        self._types_search = False
        self._selected_before: tuple[int, ...] = ()
        self._own_click = False

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        document = ui.session.document
        if document is None:
            imgui.push_text_wrap_pos(0)
            imgui.text_disabled(translate("Instances of the open scene appear here."))
            imgui.pop_text_wrap_pos()
            return
        if self._query.class_name is not None and self._query.class_name not in dict(self._rows.classes):
            self._query = replace(self._query, class_name=None)
        self._draw_search(ui, document)
        self._take_rename(ui)
        self._rows.update(document, self._query)
        self._draw_class_chips(ui)
        self._draw_banner(ui, document)
        self._handle_keys(ui, document)
        self._draw_table(ui, document)
        self._seen_moving.draw(ui, document.scene.seen_movers, document.scene.views)
        self._take_rename(ui)

    # ------------------------------------------------------------------ above the list

    def _draw_search(self, ui: Ui, document: Document) -> None:
        code_button = document.scene.code_bits > 0
        room = imgui.get_frame_height() + imgui.get_style().item_inner_spacing.x if code_button else 0
        imgui.set_next_item_width(-room or -1)
        hint = f"{get_icon('ICON_FA_MAGNIFYING_GLASS')}  {translate('Name, class or number')}"
        _, search = imgui.input_text_with_hint("##search", hint, self._query.search)
        ui.mark("instances.search")
        self._types_search = imgui.is_item_active()
        self._query = replace(self._query, search=search)
        if not code_button:
            return
        imgui.same_line(0, imgui.get_style().item_inner_spacing.x)
        imgui.push_style_color(imgui.Col_.text, rgba(ACCENT if self._shows_codes else DIM))
        if imgui.button(get_icon("ICON_FA_BARCODE"), ImVec2(imgui.get_frame_height(), 0)):
            self._flips_codes = True
        imgui.pop_style_color()
        ui.mark("instances.codes")
        imgui.set_item_tooltip(translate("Show the codeword of each instance, bit by bit"))

    def _draw_class_chips(self, ui: Ui) -> None:
        """Draw one button per class, as many as fit into a line; a click lists only that class, a second one all."""
        if len(self._rows.classes) < 2:
            return
        imgui.push_style_var(imgui.StyleVar_.frame_rounding, imgui.get_text_line_height() / 2)
        imgui.push_style_var(imgui.StyleVar_.frame_padding, scale_size(7, 1))
        imgui.push_style_var(imgui.StyleVar_.item_spacing, scale_size(4, 6))
        more, end = (
            imgui.calc_text_size("…").x + scale_pixels(18),
            imgui.get_cursor_screen_pos().x + imgui.get_content_region_avail().x,
        )
        chosen = self._query.class_name
        # The chosen class comes first, so that it always fits.
        order = sorted(self._rows.classes, key=lambda item: item[0] != chosen)
        left: list[tuple[str, int]] = []
        for number, (name, count) in enumerate(order):
            text = f"{name or translate(UNKNOWN)} {count}"
            last = number == len(order) - 1
            x = imgui.get_cursor_screen_pos().x if number == 0 else imgui.get_item_rect_max().x + scale_pixels(4)
            if number and x + imgui.calc_text_size(text).x + scale_pixels(14) + (0 if last else more) > end:
                left = order[number:]
                break
            if number:
                imgui.same_line()
            self._draw_chip(ui, name, text, name == chosen)
        imgui.pop_style_var(1)
        if left:
            imgui.same_line(0, scale_pixels(4))
            self._draw_other_chips(ui, left)
        imgui.pop_style_var(2)

    def _draw_chip(self, ui: Ui, name: str, text: str, on: bool) -> None:
        if on:
            push_accent_fill()
        if imgui.button(f"{text}###class {name}"):
            self._query = replace(self._query, class_name=None if on else name)
        if on:
            pop_accent_fill()
        ui.mark(f"instances.class.{name or UNKNOWN}")
        if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
            only = phrase("List only {name}", name=name) if name else phrase("List only instances without a class")
            imgui.set_tooltip(translate("List all classes again") if on else translate(only))

    def _draw_other_chips(self, ui: Ui, classes: list[tuple[str, int]]) -> None:
        if imgui.button("…##classes"):
            imgui.open_popup("##classes")
        ui.mark("instances.classes")
        if imgui.begin_popup("##classes"):
            for name, count in classes:
                if imgui.selectable(f"{name or translate(UNKNOWN)}  {count}###{name}", False)[0]:
                    self._query = replace(self._query, class_name=name)
                ui.mark(f"instances.class.{name or UNKNOWN}")
            imgui.end_popup()

    def _draw_banner(self, ui: Ui, document: Document) -> None:
        """Say what keeps instances out of the list or the view, with a button to undo it."""
        solo, shown = ui.session.visibility.solo.ids, len(self._rows.ids)
        if shown < self._rows.total:
            self._draw_notice(
                ui,
                phrase("{shown:,} of {total:,}", shown=shown, total=self._rows.total),
                "Select",
                "instances.select_shown",
                shown > 0,
                self._select_shown,
            )
        if solo:
            left = len(document.find_visible_instances())
            what = (
                phrase("Only {instances} shown", instances=format_count(left, "instance"))
                if left
                else "Everything is hidden"
            )
            self._draw_notice(
                ui, what, "Show all", "instances.leave_solo", True, lambda ui: ui.session.visibility.solo.leave()
            )

    def _draw_notice(self, ui: Ui, text: str, button: str, mark: str, enabled: bool, action) -> None:
        imgui.align_text_to_frame_padding()
        imgui.text_colored(rgba(ACCENT if mark == "instances.leave_solo" else DIM), translate(text))
        width = imgui.calc_text_size(translate(button)).x + 2 * imgui.get_style().frame_padding.x
        imgui.same_line(imgui.get_cursor_start_pos().x + imgui.get_content_region_avail().x - width)
        imgui.begin_disabled(not enabled)
        if imgui.button(make_label(button, mark)):
            action(ui)
        imgui.end_disabled()
        ui.mark(mark)

    def _select_shown(self, ui: Ui) -> None:
        self._own_click = True
        ui.session.selection.select(self._rows.ids)

    # ------------------------------------------------------------------ by keys

    def _handle_keys(self, ui: Ui, document: Document) -> None:
        """Walk from row to row by arrows, Home and End; Shift extends the selection, Enter renames."""
        io = imgui.get_io()
        if ui.popup_open or not imgui.is_window_focused(imgui.FocusedFlags_.child_windows):
            return
        typing = io.want_text_input or self._painter.renamed != 0
        if not typing:
            ui.claimed_shortcuts = OWN_SHORTCUTS
            if imgui.is_key_pressed(imgui.Key.enter, False) and len(ui.session.selection.ids) == 1:
                ui.session.requests.put(AskName(ui.session.selection.ids[0]))
        for key, step in WALKING.items():
            allowed = not typing or (self._types_search and step in ("up", "down"))
            if allowed and not io.key_ctrl and not io.key_alt and imgui.is_key_pressed(key):
                self._step(ui, document, step, io.key_shift)

    def _step(self, ui: Ui, document: Document, step: Step, extends: bool) -> None:
        ids, selected = self._rows.ids, ui.session.selection.ids
        if self._walk.cursor not in selected:  # something else was selected since, for example in the view
            start = next((i for i in selected if i in self._rows.place), 0)
            self._walk = Walk(start, start)
        self._walk = self._walk.advance(step, extends, ids, lambda i: not document.summarize_instance(i).is_locked)
        if self._walk.cursor not in self._rows.place:
            return
        self._own_click, self._scroll_to = True, self._walk.cursor
        chosen = self._walk.list_range(ids) if extends else (self._walk.cursor,)
        if chosen != selected:
            ui.session.selection.select(chosen)

    # ------------------------------------------------------------------ the list

    def _draw_table(self, ui: Ui, document: Document) -> None:
        flags = imgui.TableFlags_
        style = (
            flags.scroll_y | flags.row_bg | flags.sortable | flags.hideable | flags.resizable | flags.no_saved_settings
        )
        below = self._seen_moving.measure_height(document.scene.seen_movers)
        imgui.push_style_var(imgui.StyleVar_.cell_padding, scale_size(3, 3))
        if imgui.begin_table("##instances", len(COLUMNS), style | flags.no_borders_in_body, ImVec2(0, -below)):
            self._set_up_columns(document)
            self._draw_rows(ui, document)
            imgui.end_table()
        imgui.pop_style_var()

    def _set_up_columns(self, document: Document) -> None:
        fixed, stretch = imgui.TableColumnFlags_.width_fixed, imgui.TableColumnFlags_.width_stretch
        em = imgui.get_font_size()
        code_width = min(document.scene.code_bits, 12) * scale_pixels(BIT_SIZE + 1)
        for number, column in enumerate(COLUMNS):
            width = code_width if column.name == "Code" else column.width * em
            flags = stretch if column.stretches else fixed
            imgui.table_setup_column(
                make_label(column.header, column.name),
                flags | column.flags,
                column.width if column.stretches else width,
                number,
            )
        imgui.table_setup_scroll_freeze(0, 1)
        names = [column.name for column in COLUMNS]
        code = names.index("Code")
        self._shows_codes = bool(imgui.table_get_column_flags(code) & imgui.TableColumnFlags_.is_enabled)
        if self._flips_codes:
            imgui.table_set_column_enabled(code, not self._shows_codes)
            self._flips_codes = False
        imgui.table_headers_row()
        specs = imgui.table_get_sort_specs()
        if specs is not None and specs.specs_dirty and specs.specs_count:
            spec = specs.get_specs(0)
            descending = spec.sort_direction == imgui.SortDirection.descending
            self._query = replace(self._query, column=names[spec.column_index], descending=descending)
            specs.specs_dirty = False
            self._rows.update(document, self._query)

    def _draw_rows(self, ui: Ui, document: Document) -> None:
        selected, solo = ui.session.selection.ids, ui.session.visibility.solo.ids
        chosen = set(selected)
        scroll_to = self._find_newly_selected(selected)
        if self._painter.renamed and self._painter.is_new:
            scroll_to = self._rows.place.get(self._painter.renamed)
        self._painter.begin()
        clipper = imgui.ListClipper()
        clipper.begin(len(self._rows.instances))
        walked_to = self._rows.place.get(self._scroll_to)
        self._scroll_to = 0
        for row in (scroll_to, walked_to):
            if row is not None:
                clipper.include_item_by_index(row)
        while clipper.step():
            for number in range(clipper.display_start, clipper.display_end):
                instance = self._rows.instances[number]
                summary = document.summarize_instance(instance.id)
                row = Row(instance, summary, instance.id in chosen, instance.id in solo, document.scene.code_bits)
                if self._painter.draw(ui, row):
                    self._click(ui, row)
                if number == scroll_to:
                    imgui.set_scroll_here_y(0.5)
                elif number == walked_to:
                    _keep_in_view()
        if not self._rows.instances:
            imgui.table_next_row()
            imgui.table_set_column_index([column.name for column in COLUMNS].index("Name"))
            imgui.text_disabled(translate("No instances" if not self._rows.total else "No matches"))

    def _find_newly_selected(self, selected: tuple[int, ...]) -> int | None:
        """Find the row to scroll to: the first one selected elsewhere since the last frame."""
        if selected == self._selected_before:
            return None
        before, own = set(self._selected_before), self._own_click
        self._selected_before, self._own_click = selected, False
        new = [i for i in selected if i not in before and i in self._rows.place]
        return self._rows.place[new[0]] if new and not own else None

    def _click(self, ui: Ui, row: Row) -> None:
        io, session, instance = imgui.get_io(), ui.session, row.instance.id
        self._own_click = True
        if io.key_shift and self._walk.anchor in self._rows.place:
            self._walk = replace(self._walk, cursor=instance)
            session.selection.select(self._walk.list_range(self._rows.ids), "add" if io.key_ctrl else "replace")
            return
        self._walk = Walk(instance, instance)
        if row.summary.is_locked:
            session.messages.info(phrase("{name} is locked. Unlock it to select it", name=row.instance.name))
        elif io.key_ctrl:
            session.selection.select((instance,), "remove" if row.selected else "add")
        else:
            session.selection.select((instance,))

    def _take_rename(self, ui: Ui) -> None:
        """Start renaming in the instance's row if the user asked for it, and make sure that the list shows the row."""
        session = ui.session
        request = session.requests.take(AskName)
        if request is None or session.document is None:
            return
        if request.instance in session.document.scene.table:
            if request.instance not in self._rows.place:
                self._query = replace(self._query, search="", class_name=None)
            self._painter.rename(session.document.scene.table[request.instance])


def _keep_in_view() -> None:
    """Scroll just as far as the last item's row is outside the visible list below its frozen header."""
    top, height = imgui.get_window_pos().y, imgui.get_window_height()
    row = imgui.get_item_rect_max().y - imgui.get_item_rect_min().y + 2 * imgui.get_style().cell_padding.y
    above = top + row - (imgui.get_item_rect_min().y - imgui.get_style().cell_padding.y)
    below = imgui.get_item_rect_max().y + imgui.get_style().cell_padding.y - (top + height)
    if above > 0 or below > 0:
        imgui.set_scroll_y(imgui.get_scroll_y() + (below if below > 0 else -above))
