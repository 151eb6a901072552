"""The time steps of the drive, and the cameras that recorded it."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.language.translation import translate
from instdrive_app.panels.driving.timeline_keys import TimelineKeys
from instdrive_app.panels.widgets.theme import pack_color
from instdrive_app.panels.widgets.ui import (
    Ui,
    draw_action_button,
    draw_bounded_slider,
    draw_dim_text,
    fit_text,
    get_icon,
    scale_pixels,
    scale_size,
)
from instdrive_app.preferences.themes import ACCENT
from instdrive_app.session.versioned_cache import VersionedCache
from instdrive_app.state import Comparison, Reference
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.presence import list_passing
from instdrive_core.scene.track import Track
from instdrive_core.wording import phrase

SLIDER_WIDTH = 12
"""Width, in font sizes, that slider and time need; where less is left of the line, they begin another."""

HINTS = {
    Comparison.BESIDE: "{picture} beside the splats",
    Comparison.WIPE: "{picture} at the left, splats at the right; drag the line between them",
    Comparison.FLICKER: "{picture} and splats in turn",
    Comparison.ERROR: "How far the splats are from the photo",
}
"""What is said of each way to compare, where there is no slider."""


class TimelinePanel:
    """Steps, plays and scrubs through the drive, and chooses a dataset camera."""

    def __init__(self) -> None:
        self._keys = TimelineKeys()
        self._passing: VersionedCache[tuple[Track, ...]] = VersionedCache()

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        session = ui.session
        document, timeline = session.document, session.navigation.timeline
        if document is None or not timeline.steps:
            text = "The scene has no cameras and no moving objects." if document else "No scene is open."
            imgui.text_disabled(translate(text))
            return
        for name in ("time.previous", "time.play", "time.next"):
            draw_action_button(ui, session.actions[name], scale_size(30, 0))
            imgui.same_line()
        if timeline.camera_names:
            self._draw_cameras(ui)
            imgui.same_line()
        if imgui.get_content_region_avail().x < SLIDER_WIDTH * imgui.get_font_size():
            imgui.new_line()
        step, last = timeline.find_step(session.state.time), max(len(timeline.steps) - 1, 1)
        label = f"{session.state.time:.2f} s   {step + 1} / {len(timeline.steps)}"
        imgui.set_next_item_width(-imgui.calc_text_size(label).x - scale_pixels(12))
        imgui.set_next_item_allow_overlap()
        changed, chosen = imgui.slider_int("##time", step, 0, last, "", imgui.SliderFlags_.no_input)
        ui.mark("timeline.slider")
        low, high = imgui.get_item_rect_min(), imgui.get_item_rect_max()
        imgui.same_line()
        draw_dim_text(label)
        inset = imgui.get_style().grab_min_size / 2 + scale_pixels(2)
        line = imgui.get_cursor_screen_pos()
        self._draw_presence(ui, document, low.x + inset, high.x - inset, high.y)
        self._keys.draw(ui, low.x + inset, high.x - inset, (low.y + high.y) / 2)
        imgui.set_cursor_screen_pos(line)
        if changed:
            session.navigation.set_time(timeline.steps[min(chosen, len(timeline.steps) - 1)])
        if timeline.camera_names:
            self._draw_reference(ui)

    def _draw_presence(self, ui: Ui, document: Document, left: float, right: float, bottom: float) -> None:
        """Underline the times at which what is selected is there, if it is not there all the time."""
        timeline, ids = ui.session.navigation.timeline, ui.session.selection.ids
        key = (ids, document.versions, timeline.steps)
        passing = self._passing.get(document, key, lambda: list_passing(document, ids, timeline.steps))
        per_second, width = (right - left) / max(timeline.end - timeline.start, 1e-9), scale_pixels(2)
        draw = imgui.get_window_draw_list()
        for track in passing:
            start, end = (left + (time - timeline.start) * per_second for time in (track.times[0], track.times[-1]))
            if start <= right and end >= left:
                first, last = ImVec2(max(start, left) - width, bottom - width), ImVec2(min(end, right) + width, bottom)
                draw.add_rect_filled(first, last, pack_color(ACCENT))

    def _draw_reference(self, ui: Ui) -> None:
        """Draw the switches that show photos or masks over the splats or beside them."""
        session, state = ui.session, ui.session.state
        for name in ("view.photo", "view.masks", "view.beside", "view.wipe", "view.flicker", "view.error"):
            draw_action_button(ui, session.actions[name], scale_size(30, 0))
            imgui.same_line()
        if state.dataset_view is None:
            _draw_hint("Choose a camera to compare the splats with its photos")
        elif state.reference is Reference.NONE:
            known = session.document is not None and session.document.scene.views[state.dataset_view].photo
            _draw_hint("Compare with the photo or its masks" if known else "This scene comes without its photos")
        elif state.comparison is not Comparison.OVER:
            _draw_hint(phrase(HINTS[state.comparison], picture=phrase(state.reference.value)))
        else:
            imgui.set_next_item_width(imgui.get_font_size() * 12)
            form = f"{translate(state.reference.value)} %.0f %%"
            changed, percent = draw_bounded_slider("##reference", 100 * state.reference_opacity, 0, 100, form)
            if changed:
                state.reference_opacity = percent / 100
            ui.mark("timeline.reference_opacity")

    def _draw_cameras(self, ui: Ui) -> None:
        session = ui.session
        assert session.document is not None
        current = session.state.dataset_view
        name = session.document.scene.views[current].name if current is not None else translate("Free camera")
        imgui.set_next_item_width(min(imgui.get_font_size() * 12, imgui.get_content_region_avail().x))
        if imgui.begin_combo("##camera", f"{get_icon('ICON_FA_VIDEO')}  {name.replace('_', ' ')}"):
            for camera in session.navigation.timeline.camera_names:
                if imgui.selectable(camera.replace("_", " "), current is not None and camera == name)[0]:
                    session.navigation.choose_camera(camera)
                ui.mark(f"timeline.camera.{camera}")
            imgui.end_combo()
        ui.mark("timeline.camera")


def _draw_hint(text: str) -> None:
    """Draw dimmed text, cut where the panel is too narrow, and whole in its tooltip then."""
    text = translate(text)
    fitted = fit_text(text, imgui.get_content_region_avail().x)
    draw_dim_text(fitted)
    if fitted != text and imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
        imgui.set_tooltip(text)
