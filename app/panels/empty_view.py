"""The viewport while no scene is open: ways to open one."""

from __future__ import annotations

from pathlib import Path

from imgui_bundle import ImVec2, imgui

from instdrive_app.jobs import Job
from instdrive_app.language.translation import make_label, translate
from instdrive_app.panels.widgets.theme import pop_accent_fill, push_accent_fill, rgba
from instdrive_app.panels.widgets.ui import (
    Rectangle,
    Ui,
    draw_dim_text,
    fit_text,
    make_icon_label,
    name_work,
    scale_pixels,
    scale_size,
)
from instdrive_app.preferences.themes import DIM, TEXT, Color, Role

WIDTH = 340.0
"""Width of the column, in pixels at scale 1."""
RECENTS = 6


class EmptyView:
    """Shows three buttons, recent files and a hint; while the first scene is being opened, the progress."""

    def __init__(self) -> None:
        self._height = 0.0
        """Height, in pixels, of what the last frame drew."""

    def draw(self, ui: Ui, place: Rectangle) -> None:
        """Draw one frame."""
        width = min(scale_pixels(WIDTH), place.width - scale_pixels(20))
        left = place.x + (place.width - width) / 2
        top = place.y + max((place.height - self._height) / 2, scale_pixels(8))
        imgui.set_cursor_screen_pos(ImVec2(left, top))
        imgui.begin_group()
        job = ui.session.jobs.current
        if job is not None and job.modal:
            _draw_opening(ui, job, width)
        else:
            self._draw_ways(ui, left, width, place.y + place.height)
        imgui.end_group()
        self._height = imgui.get_item_rect_size().y

    def _draw_ways(self, ui: Ui, left: float, width: float, bottom: float) -> None:
        commands, tall = ui.session.actions, scale_pixels(34)
        imgui.push_font(ui.fonts.bold, imgui.get_style().font_size_base * 1.5)
        _draw_centered("Open a drive", left, width, TEXT)
        imgui.pop_font()
        imgui.spacing()
        push_accent_fill()
        if imgui.button(make_icon_label("ICON_FA_FOLDER_OPEN", "Open…", gap="   "), ImVec2(width, tall)):
            commands.run("file.open")
        pop_accent_fill()
        ui.mark("empty.open")
        imgui.begin_disabled(not commands["file.sample"].enabled())
        if imgui.button(make_icon_label("ICON_FA_CITY", "Open the sample scene", gap="   "), ImVec2(width, tall)):
            commands.run("file.sample")
        imgui.end_disabled()
        ui.mark("empty.sample")
        if imgui.button(
            make_icon_label("ICON_FA_WAND_MAGIC_SPARKLES", "New from photos, video or a drive…", gap="   "),
            ImVec2(width, tall),
        ):
            commands.run("file.new")
        ui.mark("empty.new")
        _draw_centered("or drop a scene, a video or a folder here", left, width, DIM)
        line = imgui.get_text_line_height_with_spacing()
        room = int((bottom - imgui.get_cursor_screen_pos().y - 3 * line) / line)
        recents = ui.session.files.recents.paths[: max(min(RECENTS, room), 0)]
        if recents:
            imgui.dummy(scale_size(1, 6))
            draw_dim_text(translate("Recent"))
        for number, path in enumerate(recents):
            self._draw_recent(ui, number, path, width)

    def _draw_recent(self, ui: Ui, number: int, path: Path, width: float) -> None:
        """Draw one line: the file's name, and its folder dimmed."""
        session, at, draw = ui.session, imgui.get_cursor_screen_pos(), imgui.get_window_draw_list()
        if imgui.selectable(f"##recent {number}", False, 0, ImVec2(width, 0))[0]:
            session.files.leave(lambda: session.files.open(path))
        ui.mark(f"empty.recent.{number}")
        if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
            imgui.set_tooltip(str(path))
        name = fit_text(path.name, 0.6 * width)
        begun = imgui.calc_text_size(name).x + scale_pixels(12)
        draw.add_text(at, imgui.get_color_u32(rgba(TEXT)), name)
        folder = fit_text(str(path.parent), width - begun)
        draw.add_text(ImVec2(at.x + begun, at.y), imgui.get_color_u32(rgba(DIM)), folder)


def _draw_opening(ui: Ui, job: Job, width: float) -> None:
    imgui.text(fit_text(name_work(job), width))
    known = job.share is not None
    imgui.progress_bar((job.share or 0.0) if known else -1.0 * imgui.get_time(), ImVec2(width, scale_pixels(6)), "")
    imgui.begin_disabled(not known or job.stop.is_set())
    if imgui.button(make_label("Cancel"), ImVec2(width, 0)):
        ui.session.jobs.cancel()
    imgui.end_disabled()
    ui.mark("progress.cancel")


def _draw_centered(text: str, left: float, width: float, color: Color | Role) -> None:
    text = translate(text)
    imgui.set_cursor_screen_pos(
        ImVec2(left + (width - imgui.calc_text_size(text).x) / 2, imgui.get_cursor_screen_pos().y)
    )
    imgui.text_colored(rgba(color), text)
