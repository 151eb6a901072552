"""A banner over the sketch of a scene that is being opened: how far it is, what works meanwhile, and Cancel."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.jobs import Job
from instdrive_app.language.translation import make_label, translate
from instdrive_app.panels.widgets.theme import rgba
from instdrive_app.panels.widgets.ui import Rectangle, Ui, draw_dim_text, fit_text, name_work, scale_pixels
from instdrive_app.preferences.themes import BACKGROUND

WIDTH, MARGIN = 420.0, 12.0
"""Pixels at scale 1."""


def draw_opening_banner(ui: Ui, place: Rectangle, job: Job) -> None:
    """Draw the banner at the top of the picture; the picture around it keeps the mouse."""
    width = min(scale_pixels(WIDTH), place.width - 2 * scale_pixels(MARGIN))
    imgui.set_next_window_pos(
        ImVec2(place.x + place.width / 2, place.y + scale_pixels(MARGIN)), imgui.Cond_.always, ImVec2(0.5, 0)
    )
    imgui.set_next_window_size(ImVec2(width, 0))
    flags = imgui.WindowFlags_
    fixed = flags.no_decoration | flags.no_saved_settings | flags.no_docking | flags.no_move | flags.no_nav
    imgui.push_style_color(imgui.Col_.window_bg, rgba(BACKGROUND, 0.94))
    imgui.begin("##opening", None, fixed | flags.no_focus_on_appearing)
    button = imgui.calc_text_size(translate("Cancel")).x + 2 * imgui.get_style().frame_padding.x
    percent = f"{100 * (job.share or 0):.0f} %"
    room = imgui.get_content_region_avail().x - button - imgui.calc_text_size("100 %").x - scale_pixels(28)
    imgui.align_text_to_frame_padding()
    imgui.text(fit_text(name_work(job), room))
    imgui.same_line()
    draw_dim_text(percent)
    imgui.same_line(imgui.get_window_width() - button - imgui.get_style().window_padding.x)
    imgui.begin_disabled(job.stop.is_set())
    if imgui.button(make_label("Cancel")):
        ui.session.jobs.cancel()
    imgui.end_disabled()
    ui.mark("progress.cancel")
    imgui.progress_bar(job.share or 0.0, ImVec2(-1, scale_pixels(6)), "")
    imgui.push_text_wrap_pos(0.0)
    draw_dim_text(translate("A first sketch of the scene. Look around; editing begins when all of it has been read."))
    imgui.pop_text_wrap_pos()
    low, size = imgui.get_window_pos(), imgui.get_window_size()
    ui.marks["opening"] = (low.x, low.y, low.x + size.x, low.y + size.y)
    imgui.end()
    imgui.pop_style_color()
