"""The list of instances: swatch, number, name, class, count, eye; in step with the view's selection."""

from __future__ import annotations

from collections.abc import Callable

from imgui_bundle import ImVec2, imgui

from instdrive_app.panels.instance_menu import instance_menu
from instdrive_app.panels.ui import Ui, fitted_text, icon, swatch
from instdrive_app.theme import DIM, rgba
from instdrive_core.edits.document import Document, InstanceSummary
from instdrive_core.instances.table import Instance

COLUMNS = ("", "#", "Name", "Class", "Splats", " ")
SORT_KEYS: dict[int, Callable[[Instance], object]] = {
    1: lambda instance: instance.id,
    2: lambda instance: instance.name.lower(),
    3: lambda instance: instance.class_name.lower(),
    4: lambda instance: instance.count,
}


class InstancesPanel:
    """Search, sort, select (Shift: a range, Ctrl: one more or less), hide by the eye."""

    def __init__(self) -> None:
        self._search = ""
        self._sort = (1, False)
        self._anchor = 0
        self._selected_before: tuple[int, ...] = ()
        self._own_click = False

    def draw(self, ui: Ui) -> None:
        """One frame."""
        document = ui.session.document
        if document is None:
            imgui.text_disabled("Instances of the open scene appear here.")
            return
        imgui.set_next_item_width(-1)
        hint = f"{icon('ICON_FA_MAGNIFYING_GLASS')}  Name, class or number"
        _, self._search = imgui.input_text_with_hint("##search", hint, self._search)
        ui.mark("instances.search")
        flags = imgui.TableFlags_
        style = flags.scroll_y | flags.row_bg | flags.sortable | flags.resizable | flags.no_saved_settings
        if imgui.begin_table("##instances", len(COLUMNS), style | flags.pad_outer_x | flags.no_borders_in_body):
            self._columns()
            rows = self._rows(document)
            self._draw_rows(ui, document, rows)
            imgui.end_table()

    def _columns(self) -> None:
        fixed, stretch = imgui.TableColumnFlags_.width_fixed, imgui.TableColumnFlags_.width_stretch
        no_sort, no_resize = imgui.TableColumnFlags_.no_sort, imgui.TableColumnFlags_.no_resize
        em = imgui.get_font_size()
        imgui.table_setup_column(COLUMNS[0], fixed | no_sort | no_resize, em)
        imgui.table_setup_column(COLUMNS[1], fixed | imgui.TableColumnFlags_.default_sort, 2.2 * em)
        imgui.table_setup_column(COLUMNS[2], stretch, 1.6)
        imgui.table_setup_column(COLUMNS[3], stretch, 1.0)
        imgui.table_setup_column(COLUMNS[4], fixed | imgui.TableColumnFlags_.prefer_sort_descending, 3.4 * em)
        imgui.table_setup_column(COLUMNS[5], fixed | no_sort | no_resize, 1.6 * em)
        imgui.table_setup_scroll_freeze(0, 1)
        imgui.table_headers_row()
        specs = imgui.table_get_sort_specs()
        if specs is not None and specs.specs_dirty and specs.specs_count:
            spec = specs.get_specs(0)
            self._sort = (spec.column_index, spec.sort_direction == imgui.SortDirection.descending)
            specs.specs_dirty = False

    def _rows(self, document: Document) -> list[Instance]:
        """Instances that are left, match the search, in order."""
        counts = document.counts()
        alive = {int(i) for i in counts.ids[counts.count > counts.deleted]}
        wanted = self._search.lower().split()
        found = [i for i in document.scene.table if i.id in alive and _matches(i, wanted)]
        column, descending = self._sort
        found.sort(key=SORT_KEYS[column], reverse=descending)  # type: ignore[arg-type]
        return found

    def _draw_rows(self, ui: Ui, document: Document, rows: list[Instance]) -> None:
        selected = ui.session.selected
        ids = [instance.id for instance in rows]
        scroll_to = self._newly_selected(selected, ids)
        clipper = imgui.ListClipper()
        clipper.begin(len(rows))
        if scroll_to is not None:
            clipper.include_item_by_index(scroll_to)
        while clipper.step():
            for number in range(clipper.display_start, clipper.display_end):
                instance = rows[number]
                summary = document.instance_flags(instance.id)
                imgui.push_id(instance.id)
                imgui.table_next_row()
                self._draw_row(ui, instance, summary, instance.id in selected, ids)
                if number == scroll_to:
                    imgui.set_scroll_here_y(0.5)
                imgui.pop_id()
        if not rows:
            imgui.table_next_row()
            imgui.table_set_column_index(2)
            imgui.text_disabled("None")

    def _newly_selected(self, selected: tuple[int, ...], ids: list[int]) -> int | None:
        """The row to scroll to: the first that was selected elsewhere since the last frame."""
        if selected == self._selected_before:
            return None
        new = [i for i in selected if i not in self._selected_before]
        self._selected_before, own = selected, self._own_click
        self._own_click = False
        return ids.index(new[0]) if new and not own and new[0] in ids else None

    def _draw_row(self, ui: Ui, instance: Instance, summary: InstanceSummary, selected: bool, ids: list[int]) -> None:
        imgui.table_set_column_index(0)
        swatch(instance)
        imgui.table_set_column_index(1)
        flags = imgui.SelectableFlags_.span_all_columns | imgui.SelectableFlags_.allow_overlap
        if imgui.selectable(str(instance.id), selected, flags)[0]:
            self._click(ui, instance.id, ids)
        ui.mark(f"instances.{instance.id}")
        if imgui.is_item_hovered():
            ui.session.state.hovered = instance.id if summary.drawn else 0
            if imgui.is_mouse_double_clicked(0):
                ui.session.navigation.frame((instance.id,))
        if imgui.begin_popup_context_item("##menu"):
            instance_menu(ui, instance.id)
            imgui.end_popup()
        faded = summary.is_hidden
        if faded:
            imgui.push_style_color(imgui.Col_.text, rgba(DIM))
        for column, text in ((2, instance.name), (3, instance.class_name)):
            imgui.table_set_column_index(column)
            imgui.text(fitted_text(text, imgui.get_content_region_avail().x))
        imgui.table_set_column_index(4)
        text = f"{summary.count - summary.deleted:,}"
        imgui.set_cursor_pos_x(
            imgui.get_cursor_pos_x() + max(imgui.get_content_region_avail().x - imgui.calc_text_size(text).x, 0)
        )
        imgui.text(text)
        if faded:
            imgui.pop_style_color()
        imgui.table_set_column_index(5)
        self._eye(ui, instance, summary)

    def _eye(self, ui: Ui, instance: Instance, summary: InstanceSummary) -> None:
        imgui.push_style_color(imgui.Col_.button, rgba(DIM, 0.0))
        imgui.push_style_color(imgui.Col_.text, rgba(DIM, 0.55 if summary.is_hidden else 1.0))
        imgui.push_style_var(imgui.StyleVar_.frame_padding, ImVec2(2, 0))
        if imgui.button(icon("ICON_FA_EYE_SLASH" if summary.is_hidden else "ICON_FA_EYE")):
            ui.session.hide((instance.id,), not summary.is_hidden)
        imgui.pop_style_var()
        imgui.pop_style_color(2)
        ui.mark(f"instances.{instance.id}.eye")

    def _click(self, ui: Ui, instance: int, ids: list[int]) -> None:
        io, session = imgui.get_io(), ui.session
        self._own_click = True
        if io.key_ctrl:
            session.select((instance,), "remove" if instance in session.selected else "add")
        elif io.key_shift and self._anchor in ids:
            first, last = sorted((ids.index(self._anchor), ids.index(instance)))
            session.select(tuple(ids[first : last + 1]))
            return
        else:
            session.select((instance,))
        self._anchor = instance


def _matches(instance: Instance, wanted: list[str]) -> bool:
    text = f"{instance.id} {instance.name} {instance.class_name}".lower()
    return all(word in text for word in wanted)
