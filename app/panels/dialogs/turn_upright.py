"""Asks which way is up in a scene that lies on its side, and for its unit of length."""

from __future__ import annotations

from math import isfinite

import numpy as np
from imgui_bundle import ImVec2, imgui
from jaxtyping import Float64
from numpy import ndarray

from instdrive_app.language.translation import make_label, translate
from instdrive_app.panels.dialogs.frame import center_next_window, draw_confirm_buttons
from instdrive_app.panels.widgets.ui import Ui, draw_dim_text
from instdrive_app.session.requests import AskUp
from instdrive_core.edits.kinds.turn_scene import SCALE_LIMITS
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.up_estimate import UpEstimate
from instdrive_core.scene.upright import (
    AXES,
    UP,
    Axis,
    compute_axis_direction,
    compute_upright_rotation,
    find_nearest_axis,
    format_axis,
)
from instdrive_core.wording import chain_sentences, list_phrases, phrase

TITLE = "Turn upright"
VIEW, GROUND = "view", "ground"
"""Choices beside the axes: up in the view, and up from a ground that is aligned with no axis."""
Choice = Axis | str


class TurnUprightDialog:
    """Offers the axes, the view's up and an estimate, which is chosen when it arrives unless the user was quicker."""

    def __init__(self) -> None:
        self._choice: Choice = UP
        self._chosen = False
        """Whether the user has made a choice."""
        self._scale = 1.0

    def open(self, ui: Ui, request: AskUp) -> None:
        """Open it, and guess which way is up."""
        self._choice, self._chosen, self._scale = UP, False, 1.0
        ui.session.orientation.guess_up(self._propose)
        imgui.open_popup(make_label(TITLE))

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        em = imgui.get_font_size()
        center_next_window(ImVec2(31 * em, 0))
        if not imgui.begin_popup_modal(make_label(TITLE), None, imgui.WindowFlags_.no_saved_settings)[0]:
            return
        estimate = ui.session.orientation.estimate
        imgui.text(translate("Which direction of the scene is up?"))
        imgui.spacing()
        self._draw_axes(ui)
        self._draw_other_choices(ui, estimate)
        imgui.spacing()
        self._draw_scale_field(ui)
        imgui.separator()
        imgui.push_text_wrap_pos(0)
        up = self._find_up(ui, estimate)
        if ui.session.document is not None:
            imgui.text(translate(describe_turn(up, self._scale, ui.session.document.scene)))
        draw_dim_text(translate(describe_guess(estimate)))
        imgui.pop_text_wrap_pos()
        changes = self._scale != 1 or not np.array_equal(up, compute_axis_direction(UP))
        if draw_confirm_buttons(ui, "Turn", False, changes):
            ui.session.orientation.turn(up, self._scale)
        imgui.end_popup()

    def _propose(self, found: UpEstimate) -> None:
        if not self._chosen:
            self._choice = GROUND if found.tilt else found.axis

    def _draw_axes(self, ui: Ui) -> None:
        column = imgui.get_font_size() * 5
        for number, axis in enumerate(AXES):
            if number:
                imgui.same_line(number * column + imgui.get_style().window_padding.x)
            self._draw_radio(ui, axis, format_axis(axis))

    def _draw_other_choices(self, ui: Ui, estimate: UpEstimate | None) -> None:
        up, angle = ui.session.orientation.find_view_up()
        axis, tilt = find_nearest_axis(up)
        exact = (
            phrase("{axis}, exactly", axis=format_axis(axis))
            if tilt == 0
            else phrase("{tilt:.0f}° from {axis}", tilt=tilt, axis=format_axis(axis))
        )
        title = phrase("Up in the view: {exact}", exact=exact)
        if angle >= 1:
            title = phrase("Up in the view: {exact} (the view is {angle:.0f}° off)", exact=exact, angle=angle)
        self._draw_radio(ui, VIEW, title)
        if estimate is not None and estimate.tilt:
            self._draw_radio(
                ui, GROUND, phrase("Up by {reason}: {words}", reason=estimate.reason, words=estimate.words)
            )

    def _draw_radio(self, ui: Ui, choice: Choice, title: str) -> None:
        if imgui.radio_button(make_label(title, str(choice)), self._choice == choice):
            self._choice, self._chosen = choice, True
        ui.mark(f"upright.{choice}")

    def _draw_scale_field(self, ui: Ui) -> None:
        imgui.align_text_to_frame_padding()
        draw_dim_text(translate("Scale everything by"))
        imgui.same_line()
        imgui.set_next_item_width(imgui.get_font_size() * 6)
        _, scale = imgui.input_float("##scale", self._scale, 0.0, 0.0, "%g")
        ui.mark("upright.scale")
        if isfinite(scale):
            self._scale = min(max(scale, SCALE_LIMITS[0]), SCALE_LIMITS[1])
        imgui.same_line()
        draw_dim_text(translate("(0.01 if the file is in centimetres)"))

    def _find_up(self, ui: Ui, estimate: UpEstimate | None) -> Float64[ndarray, "3"]:
        """The chosen direction, a unit vector in the world."""
        if self._choice == VIEW:
            return ui.session.orientation.find_view_up()[0]
        if self._choice == GROUND and estimate is not None:
            return estimate.direction
        return next((compute_axis_direction(axis) for axis in AXES if axis == self._choice), compute_axis_direction(UP))


def describe_turn(up: Float64[ndarray, "3"], scale: float, scene: Scene) -> str:
    """Describe, in a few short sentences, what turning `up` (unit vector) upwards and scaling does to a scene."""
    rotation = compute_upright_rotation(up)
    angle = float(np.degrees(np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1, 1))))
    if angle == 0 and scale == 1:
        return "Nothing changes: +Z is already up."
    axis, tilt = find_nearest_axis(up)
    parts = []
    if angle:
        name = (
            format_axis(axis)
            if tilt == 0
            else phrase("the direction {tilt:.0f}° from {axis}", tilt=tilt, axis=format_axis(axis))
        )
        parts.append(phrase("The whole scene turns by {angle:.0f}°, so that {name} points up.", angle=angle, name=name))
    if scale != 1:
        parts.append(phrase("Everything becomes {scale:g} times as large.", scale=scale))
    along = {
        phrase("the drives"): scene.actors,
        phrase("the photos' cameras"): scene.views,
        phrase("the sky"): scene.sky,
    }
    if names := [name for name, found in along.items() if found]:
        parts.append(phrase("This changes with it: {names}.", names=list_phrases(names)))
    return chain_sentences(*parts, "You can undo this.")


def describe_guess(estimate: UpEstimate | None) -> str:
    """Say which way is guessed to be up, and why."""
    if estimate is None:
        return "Estimating which way is up…"
    if estimate.confident:
        return phrase("Guess: {words}, according to {reason}.", words=estimate.words, reason=estimate.reason)
    if estimate.axis == UP:
        return "Nothing suggests that the scene lies on its side."
    return phrase(
        "No ground was found. In most files from other programs, {axis} points up.", axis=format_axis(estimate.axis)
    )
