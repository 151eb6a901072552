"""A tag with the name of the camera that the viewport looks through."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.language.translation import translate
from instdrive_app.panels.overlays.ground_grid import choose_grid_spacing
from instdrive_app.panels.widgets.theme import pack_color
from instdrive_app.panels.widgets.ui import Rectangle, Ui, get_icon, scale_pixels
from instdrive_app.preferences.themes import BACKGROUND, TEXT
from instdrive_app.state import ViewMode

LEGEND_HEIGHT = 50.0
"""Height of what views other than colour show at the bottom, pixels at scale 1."""
VIEW_BUTTONS = frozenset(f"view.{mode.name.lower()}" for mode in ViewMode)


class CameraTag:
    """Names the current camera at the picture's top right."""

    def draw(self, ui: Ui, place: Rectangle) -> None:
        """Draw one frame."""
        state, document = ui.session.state, ui.session.document
        if document is None:
            return
        name = translate("Free camera")
        if state.dataset_view is not None:
            view = document.scene.views[state.dataset_view]
            name = f"{view.name.replace('_', ' ')}  ·  {view.index}"
        grid = ""
        if state.show_grid:
            grid = f"  ·  {translate('grid {spacing:g} m', spacing=choose_grid_spacing(state.viewpoint))}"
        text = f"{get_icon('ICON_FA_VIDEO')}  {name}{grid}"
        size = imgui.calc_text_size(text)
        padding, gap = scale_pixels(10), scale_pixels(5)
        right, top = place.x + place.width - padding, place.y + padding
        switch = max((rect[2] for name, rect in ui.marks.items() if name in VIEW_BUTTONS), default=0.0)
        if right - size.x - 2 * padding < switch + gap:  # no room beside the view switch
            top = place.y + place.height - padding - size.y - 2 * gap
            top -= scale_pixels(LEGEND_HEIGHT) if state.view_mode is not ViewMode.COLOR else 0.0
        draw = imgui.get_window_draw_list()
        draw.add_rect_filled(
            ImVec2(right - size.x - 2 * padding, top),
            ImVec2(right, top + size.y + 2 * gap),
            pack_color(BACKGROUND, 0.78),
            scale_pixels(4),
        )
        draw.add_text(ImVec2(right - size.x - padding, top + gap), pack_color(TEXT), text)
        ui.marks["viewport.camera_tag"] = (right - size.x - 2 * padding, top, right, top + size.y + 2 * gap)
