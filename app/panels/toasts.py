"""Messages over the window for some seconds, and the progress of modal work."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.jobs import Job
from instdrive_app.messages import Level
from instdrive_app.panels.ui import Ui, dim_text, icon
from instdrive_app.theme import BACKGROUND, ERROR, GOOD, packed, rgba

WIDTH = 380.0


def draw_toasts(ui: Ui) -> None:
    """Stack the present messages above the viewport's lower right corner."""
    if "viewport" not in ui.marks:
        return
    _, _, right, bottom = ui.marks["viewport"]
    bottom -= 12
    for number, message in enumerate(reversed(ui.session.messages.toasts)):
        error = message.level is Level.ERROR
        imgui.set_next_window_pos(ImVec2(right - 12, bottom), imgui.Cond_.always, ImVec2(1, 1))
        imgui.set_next_window_size(ImVec2(WIDTH, 0))
        flags = imgui.WindowFlags_
        passive = flags.no_decoration | flags.no_saved_settings | flags.no_docking | flags.no_focus_on_appearing
        imgui.push_style_color(imgui.Col_.window_bg, rgba(BACKGROUND, 0.94))
        imgui.begin(f"##toast{number}", None, passive | flags.no_nav | flags.no_inputs | flags.no_move)
        corner, size = imgui.get_window_pos(), imgui.get_window_size()
        bar = packed(ERROR if error else GOOD)
        imgui.get_window_draw_list().add_rect_filled(corner, ImVec2(corner.x + 3, corner.y + size.y), bar, 2)
        symbol = icon("ICON_FA_TRIANGLE_EXCLAMATION" if error else "ICON_FA_CIRCLE_CHECK")
        imgui.text_colored(rgba(ERROR if error else GOOD), symbol)
        imgui.same_line()
        imgui.text_wrapped(message.text)
        bottom -= size.y + 8
        imgui.end()
        imgui.pop_style_color()


def _progress(ui: Ui, job: Job) -> None:
    imgui.text(f"{job.title}…" if not job.stop.is_set() else "Stopping…")
    known = job.share is not None
    if known:
        percent = f"{100 * (job.share or 0):.0f} %"
        imgui.same_line(imgui.get_window_width() - imgui.calc_text_size(percent).x - 10)
        dim_text(percent)
    imgui.progress_bar((job.share or 0.0) if known else -1.0 * imgui.get_time(), ImVec2(-1, 6), "")
    imgui.set_cursor_pos_x((imgui.get_window_width() - 92) / 2)
    imgui.begin_disabled(not known or job.stop.is_set())
    if imgui.button("Cancel", ImVec2(92, 0)):
        ui.session.jobs.cancel()
    imgui.end_disabled()
    ui.mark("progress.cancel")


def draw_progress(ui: Ui) -> None:
    """A box in the middle while modal work is under way."""
    job = ui.session.jobs.current
    name = "##progress"
    if job is not None and job.modal and ui.session.document is not None:
        imgui.open_popup(name)
    center = imgui.get_main_viewport().get_center()
    imgui.set_next_window_pos(center, imgui.Cond_.always, ImVec2(0.5, 0.5))
    imgui.set_next_window_size(ImVec2(320, 0))
    flags = imgui.WindowFlags_
    if imgui.begin_popup_modal(name, None, flags.no_decoration | flags.no_saved_settings | flags.no_move)[0]:
        if job is None or not job.modal:
            imgui.close_current_popup()
        else:
            _progress(ui, job)
        imgui.end_popup()
