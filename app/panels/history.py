"""The list of editing steps; a click goes to a step."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.language.translation import translate
from instdrive_app.panels.widgets.theme import pack_color, rgba
from instdrive_app.panels.widgets.ui import Ui, fit_text, get_icon, scale_pixels
from instdrive_app.preferences.themes import ACCENT, DIM, TEXT
from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.kinds.compound import CompoundEdit
from instdrive_core.edits.registry import EDIT_KINDS
from instdrive_core.wording import count_phrase


class HistoryPanel:
    """Lists done steps, undone ones dimmed; a bar at the left marks the present step."""

    def __init__(self) -> None:
        self._seen = -1

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        document = ui.session.document
        if document is None:
            imgui.push_text_wrap_pos(0)
            imgui.text_disabled(translate("Your editing steps appear here."))
            imgui.pop_text_wrap_pos()
            return
        history, target = document.history, None
        edits, moved = history.edits, self._seen != history.cursor
        clipper = imgui.ListClipper()
        clipper.begin(len(edits) + 1)
        if moved:
            clipper.include_item_by_index(history.cursor)
        while clipper.step():
            for number in range(clipper.display_start, clipper.display_end):
                if _draw_step(ui, number, edits[number - 1] if number else None, history.cursor):
                    target = number
                if moved and number == history.cursor:
                    imgui.set_scroll_here_y(0.7)
        self._seen = history.cursor
        if not edits:
            imgui.spacing()
            imgui.push_text_wrap_pos(0)
            imgui.text_disabled(translate("Nothing has been edited yet. Click a step to go back to it."))
            imgui.pop_text_wrap_pos()
        if target is not None:
            ui.session.history.jump(target)


def _draw_step(ui: Ui, number: int, edit: Edit | None, cursor: int) -> bool:
    """Draw one line and return whether it was clicked; without an edit, the line of the state that was opened."""
    present, undone = number == cursor, number > cursor
    title = translate(edit.title if edit is not None else "Opened")
    at, width = imgui.get_cursor_screen_pos(), imgui.get_font_size() * 1.7
    color = rgba(DIM, 0.7) if undone else rgba(TEXT)
    imgui.push_style_color(imgui.Col_.text, color)
    imgui.push_style_var(imgui.StyleVar_.selectable_text_align, ImVec2(0.0, 0.5))
    clicked = imgui.selectable(f"##{number}", present)[0]
    imgui.pop_style_var()
    ui.mark(f"history.{number}")
    if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
        count = abs(cursor - number)
        undo, redo = (
            count_phrase(count, "Undo {count:,} step", "Undo {count:,} steps"),
            count_phrase(count, "Redo {count:,} step", "Redo {count:,} steps"),
        )
        imgui.set_tooltip(f"{title}\n{translate('The present step' if present else redo if undone else undo)}")
    fitted = fit_text(title, imgui.get_content_region_avail().x - width)
    draw, height = imgui.get_window_draw_list(), imgui.get_text_line_height()
    if present:
        draw.add_rect_filled(
            ImVec2(at.x - scale_pixels(6), at.y - 1),
            ImVec2(at.x - scale_pixels(3), at.y + height + 1),
            pack_color(ACCENT),
        )
    glyph = get_icon(_find_icon(edit) if edit is not None else "ICON_FA_FOLDER_OPEN")
    tone = imgui.get_color_u32(rgba(ACCENT) if present else rgba(DIM, 0.5 if undone else 1.0))
    draw.add_text(ImVec2(at.x + (width - scale_pixels(6) - imgui.calc_text_size(glyph).x) / 2, at.y), tone, glyph)
    draw.add_text(ImVec2(at.x + width, at.y), imgui.get_color_u32(color), fitted)
    imgui.pop_style_color()
    return clicked


def _find_icon(edit: Edit) -> str:
    """The icon of an edit; of a step that is made of several, that of the first."""
    while isinstance(edit, CompoundEdit) and edit.edits:
        edit = edit.edits[0]
    return EDIT_KINDS[edit.kind].icon
