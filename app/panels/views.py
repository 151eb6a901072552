"""The views that the user keeps: small pictures to go back by, names, and deleting."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.actions.pictures import delete_view, show_bookmark
from instdrive_app.language.translation import translate
from instdrive_app.panels.widgets.theme import pack_color
from instdrive_app.panels.widgets.ui import Ui, draw_action_button, draw_dim_text, fit_text, get_icon, scale_pixels
from instdrive_app.preferences.themes import ACCENT, DIM, LINE
from instdrive_app.session.aids.bookmarks import THUMBNAIL, Bookmark

SMALL = 0.5
"""Size of the small pictures at scale 1, relative to their pixels."""


class ViewsPanel:
    """Lists kept views; a click on one goes there, a double click on its name renames it."""

    def __init__(self) -> None:
        self._typed, self._begun = "", -1

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        if ui.session.document is None:
            imgui.text_disabled(translate("No scene is open."))
            return
        draw_action_button(ui, ui.session.actions["view.keep"])
        imgui.same_line()
        draw_dim_text(fit_text(translate("keeps the present view"), imgui.get_content_region_avail().x))
        if not len(ui.session.aids.bookmarks):
            imgui.push_text_wrap_pos(0)
            imgui.text_disabled(translate("Kept views are saved with the project."))
            imgui.pop_text_wrap_pos()
        for index, kept in enumerate(ui.session.aids.bookmarks.kept):
            imgui.push_id(index)
            self._draw_row(ui, index, kept)
            imgui.pop_id()

    def _draw_row(self, ui: Ui, index: int, kept: Bookmark) -> None:
        bookmarks, at = ui.session.aids.bookmarks, imgui.get_cursor_screen_pos()
        width, height = (scale_pixels(SMALL * length) for length in THUMBNAIL)
        if imgui.invisible_button("##go", ImVec2(width, height)):
            show_bookmark(ui.session, index)
        ui.mark(f"views.go.{index}")
        _draw_thumbnail(ui, index, kept, at, width, height)
        if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
            imgui.set_tooltip(translate("Go to {name}", name=kept.name))
        imgui.same_line()
        imgui.begin_group()
        if bookmarks.named == index:
            self._draw_name_field(ui, index, kept)
        else:
            self._draw_name(ui, index, kept)
        if imgui.small_button(get_icon("ICON_FA_PEN")):
            bookmarks.named = index
        ui.mark(f"views.rename.{index}")
        if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
            imgui.set_tooltip(translate("Rename"))
        imgui.same_line()
        if imgui.small_button(get_icon("ICON_FA_TRASH")):
            delete_view(ui.session, index)
        ui.mark(f"views.delete.{index}")
        if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
            imgui.set_tooltip(translate("Delete this view; it cannot be undone"))
        imgui.end_group()

    def _draw_name(self, ui: Ui, index: int, kept: Bookmark) -> None:
        room = imgui.get_content_region_avail().x
        chosen = ui.session.aids.bookmarks.current == index
        clicked = imgui.selectable(
            fit_text(kept.name, room), chosen, imgui.SelectableFlags_.allow_double_click, ImVec2(room, 0)
        )[0]
        ui.mark(f"views.name.{index}")
        if clicked and imgui.is_mouse_double_clicked(0):
            ui.session.aids.bookmarks.named = index
        elif clicked:
            show_bookmark(ui.session, index)

    def _draw_name_field(self, ui: Ui, index: int, kept: Bookmark) -> None:
        bookmarks = ui.session.aids.bookmarks
        if self._begun != index:
            self._typed, self._begun = kept.name, index
            imgui.set_keyboard_focus_here()
        imgui.set_next_item_width(-1)
        flags = imgui.InputTextFlags_.enter_returns_true | imgui.InputTextFlags_.auto_select_all
        entered, self._typed = imgui.input_text("##name", self._typed, flags)
        ui.mark(f"views.name.{index}")
        if entered or imgui.is_item_deactivated():
            if not imgui.is_key_pressed(imgui.Key.escape):
                bookmarks.rename(index, self._typed)
            bookmarks.named, self._begun = None, -1


def keep_thumbnails(ui: Ui) -> None:
    """Take the small picture of a kept view once the window shows it completely."""
    snapshot = ui.view.snapshot
    if snapshot is None or not len(ui.session.aids.bookmarks) or not ui.view.settled:
        return
    index = ui.session.aids.bookmarks.find_pictureless(snapshot.camera.world_from_camera, snapshot.time)
    if index is not None:
        ui.session.aids.bookmarks.set_thumbnail(index, ui.view.renderer.read_picture())


def _draw_thumbnail(ui: Ui, index: int, kept: Bookmark, at: ImVec2, width: float, height: float) -> None:
    """Draw the small picture, as large as fits, in a frame that is bright for the present view."""
    draw, corner = imgui.get_window_draw_list(), ImVec2(at.x + width, at.y + height)
    if kept.thumbnail is None:
        glyph = get_icon("ICON_FA_IMAGE")
        size = imgui.calc_text_size(glyph)
        middle = ImVec2(at.x + (width - size.x) / 2, at.y + (height - size.y) / 2)
        draw.add_text(middle, pack_color(DIM), glyph)
    else:
        rows, columns = kept.thumbnail.shape[:2]
        factor = min(width / columns, height / rows)
        left, top = at.x + (width - columns * factor) / 2, at.y + (height - rows * factor) / 2
        texture = imgui.ImTextureRef(ui.textures.show(f"kept_view_{index}", kept.thumbnail))
        draw.add_image(texture, ImVec2(left, top), ImVec2(left + columns * factor, top + rows * factor))
    is_current = ui.session.aids.bookmarks.current == index
    draw.add_rect(at, corner, pack_color(ACCENT if is_current else LINE), scale_pixels(3), thickness=scale_pixels(1.5))
