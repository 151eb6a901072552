"""The bar that offers to turn a scene upright which seems to lie on its side, or of which nothing says what is up."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.language.translation import make_label, translate
from instdrive_app.panels.widgets.theme import rgba
from instdrive_app.panels.widgets.ui import Rectangle, Ui, scale_pixels
from instdrive_app.preferences.themes import BACKGROUND
from instdrive_app.session.turn_controller import TurnOffer
from instdrive_core.wording import phrase

TOP = 48.0
"""Distance from the picture's top, below the view modes; pixels at scale 1."""


class UprightBar:
    """Asks which way is up; each button shows its answer in the view at once, as a step that can be undone."""

    def draw(self, ui: Ui, place: Rectangle) -> None:
        """Draw one frame."""
        orientation = ui.session.orientation
        offer = orientation.offer
        if offer is None:
            return
        imgui.set_next_window_pos(
            ImVec2(place.x + place.width / 2, place.y + scale_pixels(TOP)), imgui.Cond_.always, ImVec2(0.5, 0)
        )
        flags = imgui.WindowFlags_
        still = flags.no_decoration | flags.always_auto_resize | flags.no_saved_settings | flags.no_docking
        imgui.push_style_color(imgui.Col_.window_bg, rgba(BACKGROUND, 0.95))
        imgui.begin("##upright bar", None, still | flags.no_focus_on_appearing | flags.no_nav | flags.no_move)
        imgui.align_text_to_frame_padding()
        imgui.text(translate(describe_offer(offer)))
        imgui.same_line()
        imgui.begin_disabled(ui.session.jobs.is_blocking)
        for name, title, run in (
            ("turn", "Turn upright", orientation.accept_offer),
            ("flip", "Flip", orientation.flip),
            ("leave", "Done" if offer.is_answered else "Leave", orientation.dismiss_offer),
        ):
            if name == "turn" and offer.is_answered:
                continue
            imgui.same_line()
            if imgui.button(make_label(title)):
                run()
            ui.mark(f"upright.{name}")
        imgui.end_disabled()
        imgui.end()
        imgui.pop_style_color()


def describe_offer(offer: TurnOffer) -> str:
    """Say what is known about which way is up."""
    if offer.is_answered:
        return "Is it upright now?"
    if offer.ids and offer.estimate.confident:
        return phrase("What was inserted seems to lie on its side: {words} is up", words=offer.estimate.words)
    if offer.ids:
        return "Nothing says which way is up in what was inserted"
    if offer.estimate.confident:
        return phrase("This scene seems to lie on its side: {words} is up", words=offer.estimate.words)
    return "Nothing says which way is up in this scene"
