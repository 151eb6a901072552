"""What the photos show moving and the scene does not hold, listed below the instances."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.language.translation import make_label, translate
from instdrive_app.panels.widgets.theme import rgba
from instdrive_app.panels.widgets.ui import Ui, get_icon
from instdrive_app.preferences.themes import DIM
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.seen_moving import SeenMover
from instdrive_core.wording import format_count, phrase

MOST_ROWS = 3
"""Rows shown at a time; more are scrolled to."""


class SeenMovingList:
    """Lists what moves and was not rebuilt; a click looks through the first photo that shows it."""

    def __init__(self) -> None:
        self._is_open = True

    def measure_height(self, movers: tuple[SeenMover, ...]) -> float:
        """Measure the height that the list takes, in pixels; 0 where there is nothing to list."""
        if not movers:
            return 0.0
        rows = min(len(movers), MOST_ROWS) if self._is_open else 0
        spacing = imgui.get_style().item_spacing.y
        return imgui.get_frame_height() + 2 * spacing + rows * imgui.get_text_line_height_with_spacing()

    def draw(self, ui: Ui, movers: tuple[SeenMover, ...], views: tuple[CameraView, ...]) -> None:
        """Draw one frame; nothing where nothing was seen moving."""
        if not movers:
            return
        imgui.push_style_color(imgui.Col_.text, rgba(DIM))
        flags = imgui.TreeNodeFlags_.default_open | imgui.TreeNodeFlags_.span_avail_width
        self._is_open = imgui.collapsing_header(
            make_label("Seen moving, not rebuilt: {count}", "seen moving", count=len(movers)), flags
        )
        ui.mark("instances.seen_moving")
        if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
            imgui.set_tooltip(
                translate("The photos show these move. Training left them out, so that they do not smear")
            )
        if self._is_open:
            height = min(len(movers), MOST_ROWS) * imgui.get_text_line_height_with_spacing()
            if imgui.begin_child("##seen moving", ImVec2(0, height)):
                for number, mover in enumerate(movers, 1):
                    self._draw_row(ui, number, mover, views)
            imgui.end_child()
        imgui.pop_style_color()

    def _draw_row(self, ui: Ui, number: int, mover: SeenMover, views: tuple[CameraView, ...]) -> None:
        title = f"{get_icon('ICON_FA_PERSON_RUNNING')}  {translate(name_mover(mover, number))}"
        clicked = imgui.selectable(f"{title}   {mover.camera}###{number}", False)[0]
        ui.mark(f"instances.seen_moving.{number}")
        if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
            imgui.set_tooltip(translate(explain_mover(mover)))
        index = find_first_view(mover, views)
        if clicked and index is not None:
            ui.session.navigation.look_through(index)


def name_mover(mover: SeenMover, number: int) -> str:
    """Name a mover by its class, where one is known, and its place in the list."""
    return phrase("{label} {number}", label=mover.label or phrase("Something"), number=number)


def explain_mover(mover: SeenMover) -> str:
    """Explain where a mover was seen, and why the scene does not hold it."""
    steps = [sighting.step for sighting in mover.sightings]
    one, several = (
        phrase("step {first}", first=steps[0]),
        phrase("steps {first} to {last}", first=steps[0], last=steps[-1]),
    )
    span = one if len(steps) == 1 else several
    left, top, right, bottom = (round(100 * corner) for corner in mover.sightings[0].box)
    return phrase(
        "Seen in {photos} of {camera}, {span}.\nIn the first it fills {left}–{right} % of the "
        "width and {top}–{bottom} % of the height.\nMoving things are rebuilt where a clip has "
        "LiDAR.\nClick to look through the camera of the first photo.",
        photos=format_count(len(steps), "photo"),
        camera=mover.camera,
        span=span,
        left=left,
        right=right,
        top=top,
        bottom=bottom,
    )


def find_first_view(mover: SeenMover, views: tuple[CameraView, ...]) -> int | None:
    """Find the index of the first view that shows a mover; None where the scene has none of its photos."""
    places = {(view.name, view.index): index for index, view in enumerate(views)}
    found = (places.get((mover.camera, sighting.step)) for sighting in mover.sightings)
    return next((index for index in found if index is not None), None)
