"""Asking which way is up in a scene that lies on its side, and for its unit of length."""

from __future__ import annotations

from math import isfinite

import numpy as np
from imgui_bundle import ImVec2, imgui
from jaxtyping import Float64
from numpy import ndarray

from instdrive_app.panels.dialogs.frame import center_next_window, draw_confirm_buttons
from instdrive_app.panels.widgets.ui import Ui, draw_dim_text
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

TITLE = "Turn upright"
VIEW, GROUND = "view", "ground"
"""Choices beside the axes: the view's up, and a ground that lies askew to all axes."""
Choice = Axis | str


class TurnUprightDialog:
    """The guess is chosen as soon as it is there, unless the user was quicker."""

    names: tuple[str, ...] = ("turn_upright",)

    def __init__(self) -> None:
        self._choice: Choice = UP
        self._chosen = False
        """Whether the user has chosen."""
        self._scale = 1.0

    def ask(self, ui: Ui, name: str) -> None:
        """Open it, and guess which way is up."""
        self._choice, self._chosen, self._scale = UP, False, 1.0
        ui.session.turning.look(self._propose)
        imgui.open_popup(TITLE)

    def draw(self, ui: Ui) -> None:
        """One frame."""
        em = imgui.get_font_size()
        center_next_window(ImVec2(31 * em, 0))
        if not imgui.begin_popup_modal(TITLE, None, imgui.WindowFlags_.no_saved_settings)[0]:
            return
        estimate = ui.session.turning.estimate
        imgui.text("What points up, as the scene lies now?")
        imgui.spacing()
        self._draw_axes(ui)
        self._draw_other_choices(ui, estimate)
        imgui.spacing()
        self._draw_scale_field(ui)
        imgui.separator()
        imgui.push_text_wrap_pos(0)
        up = self._find_up(ui, estimate)
        if ui.session.document is not None:
            imgui.text(describe_turn(up, self._scale, ui.session.document.scene))
        draw_dim_text(describe_guess(estimate))
        imgui.pop_text_wrap_pos()
        changes = self._scale != 1 or not np.array_equal(up, compute_axis_direction(UP))
        if draw_confirm_buttons(ui, "Turn", False, changes):
            ui.session.turning.turn(up, self._scale)
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
        up, angle = ui.session.turning.view_up()
        axis, tilt = find_nearest_axis(up)
        exact = f"{format_axis(axis)}, exactly" if tilt == 0 else f"{tilt:.0f}° from {format_axis(axis)}"
        near = f" (the view is {angle:.0f}° off)" if angle >= 1 else ""
        self._draw_radio(ui, VIEW, f"What is up in the view: {exact}{near}")
        if estimate is not None and estimate.tilt:
            self._draw_radio(ui, GROUND, f"Up by {estimate.reason}: {estimate.words}")

    def _draw_radio(self, ui: Ui, choice: Choice, title: str) -> None:
        if imgui.radio_button(f"{title}##{choice}", self._choice == choice):
            self._choice, self._chosen = choice, True
        ui.mark(f"upright.{choice}")

    def _draw_scale_field(self, ui: Ui) -> None:
        imgui.align_text_to_frame_padding()
        draw_dim_text("Scale everything by")
        imgui.same_line()
        imgui.set_next_item_width(imgui.get_font_size() * 6)
        _, scale = imgui.input_float("##scale", self._scale, 0.0, 0.0, "%g")
        ui.mark("upright.scale")
        if isfinite(scale):
            self._scale = min(max(scale, SCALE_LIMITS[0]), SCALE_LIMITS[1])
        imgui.same_line()
        draw_dim_text("(0.01 where the file is in centimetres)")

    def _find_up(self, ui: Ui, estimate: UpEstimate | None) -> Float64[ndarray, "3"]:
        """The chosen direction."""
        if self._choice == VIEW:
            return ui.session.turning.view_up()[0]
        if self._choice == GROUND and estimate is not None:
            return estimate.direction
        return next((compute_axis_direction(axis) for axis in AXES if axis == self._choice), compute_axis_direction(UP))


def describe_turn(up: Float64[ndarray, "3"], scale: float, scene: Scene) -> str:
    """What happens to a scene whose `up` becomes up, in a few short sentences."""
    rotation = compute_upright_rotation(up)
    angle = float(np.degrees(np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1, 1))))
    if angle == 0 and scale == 1:
        return "Nothing: +Z is up already."
    axis, tilt = find_nearest_axis(up)
    parts = []
    if angle:
        name = format_axis(axis) if tilt == 0 else f"what lies {tilt:.0f}° from {format_axis(axis)}"
        parts.append(f"The whole scene turns by {angle:.0f}°, so that {name} points up.")
    if scale != 1:
        parts.append(f"Everything becomes {scale:g} times as large.")
    along = {"the drives": scene.actors, "the photos' cameras": scene.views, "the sky": scene.sky}
    if names := [name for name, found in along.items() if found]:
        words = " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))
        verb = "goes" if names == ["the sky"] else "go"
        parts.append(f"{words[0].upper()}{words[1:]} {verb} along.")
    return " ".join([*parts, "It can be undone."])


def describe_guess(estimate: UpEstimate | None) -> str:
    """How the guess came about."""
    if estimate is None:
        return "Looking for the way up…"
    if estimate.confident:
        return f"Guess: {estimate.words}, known from {estimate.reason}."
    if estimate.axis == UP:
        return "Nothing in the scene says that it lies on its side."
    return f"No ground was found. In most files of other programs {format_axis(estimate.axis)} points up."
