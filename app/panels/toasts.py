"""Messages that appear over the window for some seconds, and the progress of modal jobs."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.jobs import Job
from instdrive_app.language.translation import make_label, translate
from instdrive_app.messages import Level, Message
from instdrive_app.panels.dialogs.frame import BUTTON_WIDTH
from instdrive_app.panels.widgets.theme import pack_color, rgba
from instdrive_app.panels.widgets.ui import Ui, draw_dim_text, fit_text, get_icon, name_work, scale_pixels, scale_size
from instdrive_app.preferences.themes import BACKGROUND, DIM, ERROR, GOOD

WIDTH = 380.0
"""Width of a toast, in pixels at scale 1."""
NARROWEST = 200.0
"""Where there is less room beside the tools, messages cover them."""
MARGIN = 12.0
LONGEST = 400
"""Characters of a message that are shown; the log has the whole message."""
PLACES_TAKEN = ("viewport.legend", "viewport.opacity", "deletion review")
"""Marks of what stands at the viewport's lower left and must not be covered."""


def draw_toasts(ui: Ui) -> None:
    """Stack the present messages above the viewport's lower right corner, beside the tools; a click dismisses one."""
    if "viewport" not in ui.marks:
        return
    left, top, right, bottom = ui.marks["viewport"]
    margin = scale_pixels(MARGIN)
    tools = max([left, *(place[2] for name, place in ui.marks.items() if name.startswith("tool."))])
    room = right - tools - 2 * margin
    width = min(scale_pixels(WIDTH), room if room >= scale_pixels(NARROWEST) else right - left - 2 * margin)
    taken = [ui.marks[name] for name in PLACES_TAKEN if name in ui.marks]
    tag = ui.marks.get("viewport.camera_tag")
    taken += [tag] if tag is not None and tag[1] > (top + bottom) / 2 else []
    bottom = min([bottom, *(place[1] for place in taken if place[2] > right - width - margin)]) - margin
    for number, message in enumerate(reversed(ui.session.messages.toasts)):
        if bottom < top + scale_pixels(60):  # what has no room is in the log
            break
        bottom -= _draw_toast(ui, number, message, ImVec2(right - margin, bottom), width) + scale_pixels(8)


def _draw_toast(ui: Ui, number: int, message: Message, corner: ImVec2, width: float) -> float:
    """Draw one message with its lower right corner at `corner`; returns its height in pixels."""
    error = message.level is Level.ERROR
    tone, flags = ERROR if error else GOOD, imgui.WindowFlags_
    imgui.set_next_window_pos(corner, imgui.Cond_.always, ImVec2(1, 1))
    imgui.set_next_window_size(ImVec2(width, 0))
    imgui.push_style_color(imgui.Col_.window_bg, rgba(BACKGROUND, 0.94))
    passive = flags.no_decoration | flags.no_saved_settings | flags.no_docking | flags.no_focus_on_appearing
    imgui.begin(f"##toast{number}", None, passive | flags.no_nav | flags.no_move)
    _go_below_popups()
    at, size = imgui.get_window_pos(), imgui.get_window_size()
    bar, draw = ImVec2(at.x + scale_pixels(3), at.y + size.y), imgui.get_window_draw_list()
    draw.add_rect_filled(at, bar, pack_color(tone), scale_pixels(2))
    imgui.text_colored(rgba(tone), get_icon("ICON_FA_TRIANGLE_EXCLAMATION" if error else "ICON_FA_CIRCLE_CHECK"))
    imgui.same_line(scale_pixels(34))
    cross = imgui.get_font_size()
    imgui.push_text_wrap_pos(width - scale_pixels(10) - cross)
    text = translate(message.text)
    rest = translate("… (see the log for the rest)")
    imgui.text(text if len(text) <= LONGEST else text[:LONGEST] + rest)
    imgui.pop_text_wrap_pos()
    if imgui.is_window_hovered():
        imgui.set_mouse_cursor(imgui.MouseCursor_.hand)
        place = ImVec2(at.x + size.x - scale_pixels(8) - cross, at.y + imgui.get_style().window_padding.y)
        draw.add_text(place, pack_color(DIM), get_icon("ICON_FA_XMARK"))
        if imgui.is_mouse_released(0):
            ui.session.messages.dismiss(message)
    ui.marks[f"toast.{number}"] = (at.x, at.y, at.x + size.x, at.y + size.y)
    imgui.end()
    imgui.pop_style_color()
    return size.y


def _go_below_popups() -> None:
    """Bring the present window below dialogs, menus and lists: ImGui puts a window that is new above them all, where it
    would take the clicks that are meant for them, and so close them."""
    opened = [popup.window for popup in imgui.get_current_context().open_popup_stack if popup.window is not None]
    if opened:
        imgui.internal.bring_window_to_display_behind(imgui.internal.get_current_window(), opened[0])


def _draw_job(ui: Ui, job: Job) -> None:
    room = imgui.get_content_region_avail().x - imgui.calc_text_size("100 %").x - scale_pixels(12)
    imgui.text(fit_text(name_work(job), room))
    known = job.share is not None
    if known:
        percent = f"{100 * (job.share or 0):.0f} %"
        imgui.same_line(imgui.get_window_width() - imgui.calc_text_size(percent).x - imgui.get_style().window_padding.x)
        draw_dim_text(percent)
    imgui.progress_bar((job.share or 0.0) if known else -1.0 * imgui.get_time(), scale_size(-1, 6), "")
    imgui.set_cursor_pos_x((imgui.get_window_width() - scale_pixels(BUTTON_WIDTH)) / 2)
    imgui.begin_disabled(not known or job.stop.is_set())
    if imgui.button(make_label("Cancel"), scale_size(BUTTON_WIDTH, 0)):
        ui.session.jobs.cancel()
    imgui.end_disabled()
    ui.mark("progress.cancel")


def draw_progress(ui: Ui) -> None:
    """Draw a box in the middle of the window while a modal job runs, unless a sketch shows what it is about."""
    job = ui.session.jobs.current if ui.session.sketches.shown is None else None
    name = "##progress"
    if job is not None and job.modal and ui.session.document is not None:
        imgui.open_popup(name)
    center = imgui.get_main_viewport().get_center()
    imgui.set_next_window_pos(center, imgui.Cond_.always, ImVec2(0.5, 0.5))
    imgui.set_next_window_size(scale_size(320, 0))
    flags = imgui.WindowFlags_
    if imgui.begin_popup_modal(name, None, flags.no_decoration | flags.no_saved_settings | flags.no_move)[0]:
        if job is None or not job.modal:
            imgui.close_current_popup()
        else:
            _draw_job(ui, job)
        imgui.end_popup()
