"""Runs that were trained here or opened, and their figures side by side."""

from __future__ import annotations

from imgui_bundle import imgui

from instdrive_app.language.translation import translate
from instdrive_app.panels.widgets.theme import rgba
from instdrive_app.panels.widgets.ui import Ui, draw_dim_text, fit_text, make_icon_label
from instdrive_app.preferences.themes import DIM, GOOD, TEXT
from instdrive_app.session.making.run_comparison import RunTable

HINT = "Runs that are trained or opened here are listed. A run that was never evaluated takes a while."
TITLE_SHARE = 0.4
"""Share of the panel's width that the figures' titles have at most."""


class RunsPanel:
    """A box to tick per run, a button, and the table of the runs compared last."""

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        comparison = ui.session.comparison
        runs = comparison.list_runs()
        for number, run in enumerate(runs):
            label = fit_text(f"{run.name}   {run.parent}", imgui.get_content_region_avail().x - 40)
            changed, wanted = imgui.checkbox(f"{label}##{number}", run in comparison.chosen)
            ui.mark(f"runs.{run.name}")
            if changed and wanted:
                comparison.chosen.add(run)
            elif changed:
                comparison.chosen.discard(run)
        imgui.begin_disabled(comparison.is_busy or not comparison.chosen.intersection(runs))
        if imgui.button(
            make_icon_label("ICON_FA_SCALE_BALANCED", "Comparing…" if comparison.is_busy else "Compare", "compare")
        ):
            comparison.compare()
        ui.mark("runs.compare")
        imgui.end_disabled()
        if comparison.table is None:
            imgui.push_text_wrap_pos(0)
            draw_dim_text(translate(HINT))
            imgui.pop_text_wrap_pos()
        else:
            imgui.push_text_wrap_pos(0)
            for note in comparison.table.notes:
                draw_dim_text(translate(note))
            imgui.pop_text_wrap_pos()
            _draw_table(ui, comparison.table)


def _draw_table(ui: Ui, table: RunTable) -> None:
    flags = imgui.TableFlags_.row_bg | imgui.TableFlags_.scroll_x | imgui.TableFlags_.scroll_y
    if not imgui.begin_table("##figures", len(table.names) + 1, flags):
        return
    imgui.table_setup_scroll_freeze(1, 1)
    most = TITLE_SHARE * imgui.get_content_region_avail().x
    for number, (name, texts) in enumerate(_list_columns(table)):
        width = max(imgui.calc_text_size(text).x for text in (name, *texts)) + imgui.get_font_size()
        width = width if number else min(width, most)
        imgui.table_setup_column(name, imgui.TableColumnFlags_.width_fixed, width)
    imgui.table_headers_row()
    for title, cells in table.rows:
        imgui.table_next_row()
        imgui.table_next_column()
        draw_dim_text(fit_text(title, most))
        for cell in cells:
            imgui.table_next_column()
            imgui.text_colored(rgba(GOOD if cell.best else TEXT), cell.text)
            if cell.delta:
                imgui.same_line()
                imgui.text_colored(rgba(DIM), cell.delta)
    imgui.end_table()
    ui.mark("runs.table")


def _list_columns(table: RunTable) -> list[tuple[str, list[str]]]:
    """Heads of the columns, and the texts below them."""
    titles = (translate("figure"), [title for title, _ in table.rows])
    runs = [
        (name, [f"{cells[number].text}  {cells[number].delta}" for _, cells in table.rows])
        for number, name in enumerate(table.names)
    ]
    return [titles, *runs]
