"""A notice while the first picture takes long."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.language.translation import translate
from instdrive_app.panels.widgets.theme import pack_color
from instdrive_app.panels.widgets.ui import Rectangle, Ui, scale_pixels
from instdrive_app.preferences.themes import PICTURE_TEXT, Color

WAIT_SECONDS = 0.7
"""Time without a picture after which the notice appears; resizing the window takes less."""
LONG_WAIT_SECONDS = 3.0
"""Time without a picture that only compiling can explain."""


class FirstPictureNotice:
    """Explains a missing picture: the very first start compiles kernels."""

    def __init__(self) -> None:
        self._since = 0.0

    def draw(self, ui: Ui, place: Rectangle) -> None:
        """Draw one frame."""
        now = imgui.get_time()
        if ui.view.snapshot is not None or ui.session.document is None:
            self._since = now
        waited = now - self._since
        if waited < WAIT_SECONDS:
            return
        middle = place.y + place.height / 2
        _draw_centered("Preparing the view…", place, middle - scale_pixels(12), PICTURE_TEXT)
        if waited > LONG_WAIT_SECONDS:
            why = "The first start compiles the drawing code for this processor. This takes about half a minute, once."
            _draw_centered(why, place, middle + scale_pixels(12), PICTURE_TEXT)
        ui.marks["viewport.preparing"] = (place.x, middle, place.x + place.width, middle + 1)


def _draw_centered(text: str, place: Rectangle, top: float, color: Color) -> None:
    text = translate(text)
    width = imgui.calc_text_size(text, wrap_width=place.width - scale_pixels(20)).x
    draw = imgui.get_window_draw_list()
    at = ImVec2(place.x + (place.width - width) / 2, top)
    draw.add_text(
        imgui.get_font(), imgui.get_font_size(), at, pack_color(color), text, wrap_width=place.width - scale_pixels(20)
    )
