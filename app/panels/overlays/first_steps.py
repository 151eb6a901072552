"""The first steps: five lines over the picture, shown once."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.action import format_shortcut
from instdrive_app.language.translation import make_label, translate
from instdrive_app.panels.widgets.theme import pop_accent_fill, push_accent_fill, rgba
from instdrive_app.panels.widgets.ui import Rectangle, Ui, get_icon, scale_pixels
from instdrive_app.preferences.key_presets import PRESETS
from instdrive_app.preferences.themes import ACCENT, BACKGROUND
from instdrive_core.wording import phrase

WIDEST, BOTTOM = 470.0, 56.0
"""Width of the box and its distance from the picture's lower edge, in pixels at scale 1."""
TOOLS, LEAST = 116.0, 200.0
"""Room that is left for the toolbar, and the least width."""


class FirstSteps:
    """Tells how to point, delete, look around, undo and find the rest; *Got it* closes it for good."""

    def draw(self, ui: Ui, place: Rectangle) -> None:
        """Draw one frame."""
        if not ui.session.state.shows_first_steps:
            return
        width = max(min(scale_pixels(WIDEST), place.width - scale_pixels(TOOLS)), scale_pixels(LEAST))
        right = min(place.x + (place.width + width + scale_pixels(TOOLS)) / 2, place.x + place.width - scale_pixels(10))
        corner = ImVec2(right, place.y + place.height - scale_pixels(BOTTOM))
        imgui.set_next_window_pos(corner, imgui.Cond_.always, ImVec2(1.0, 1.0))
        imgui.set_next_window_size(ImVec2(width, 0))
        flags = imgui.WindowFlags_
        still = flags.no_decoration | flags.always_auto_resize | flags.no_saved_settings | flags.no_docking
        imgui.push_style_color(imgui.Col_.window_bg, rgba(BACKGROUND, 0.95))
        imgui.begin("##first steps", None, still | flags.no_focus_on_appearing | flags.no_nav | flags.no_move)
        for icon, text in list_first_steps(ui):
            imgui.text_colored(rgba(ACCENT), get_icon(icon))
            imgui.same_line(scale_pixels(36))
            imgui.text_wrapped(translate(text))
        push_accent_fill()
        if imgui.button(make_label("Got it")):
            ui.session.state.shows_first_steps = False
            ui.session.preferences.change(knows_first_steps=True)
        pop_accent_fill()
        ui.mark("first_steps.close")
        low, size = imgui.get_window_pos(), imgui.get_window_size()
        ui.marks["first_steps"] = (low.x, low.y, low.x + size.x, low.y + size.y)
        imgui.end()
        imgui.pop_style_color()


def list_first_steps(ui: Ui) -> tuple[tuple[str, str], ...]:
    """List icon and text of the five lines, with the keys that the user has chosen."""

    def name_key(action_id: str) -> str:
        shortcuts = ui.session.actions[action_id].shortcuts
        return format_shortcut(shortcuts[0]) if shortcuts else f"“{translate(ui.session.actions[action_id].title)}”"

    flies = PRESETS[ui.session.preferences.current.preset].flies_always
    always = phrase("Drag turns the view, the wheel comes closer, W A S D fly.")
    held = phrase("Drag turns the view, the wheel comes closer, W A S D fly while the right button is held.")
    return (
        ("ICON_FA_ARROW_POINTER", "Point at a thing to see its outline; click to select all of it."),
        (
            "ICON_FA_TRASH",
            phrase("{key} deletes it, then offers to fill the ground that it hid.", key=name_key("edit.delete")),
        ),
        ("ICON_FA_CAMERA", always if flies else held),
        (
            "ICON_FA_ROTATE_LEFT",
            phrase("{key} undoes every edit; nothing trained is ever lost.", key=name_key("edit.undo")),
        ),
        (
            "ICON_FA_MAGNIFYING_GLASS",
            phrase(
                "{find} finds any command, {keys} lists all keys.",
                find=name_key("help.palette"),
                keys=name_key("help.shortcuts"),
            ),
        ),
    )
