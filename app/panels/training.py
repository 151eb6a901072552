"""The scene in the making: stages, time left, curves, a live picture, and what can be done with the job."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from imgui_bundle import ImVec2, imgui, implot
from jaxtyping import Float64, UInt8
from numpy import ndarray

from instdrive_app.language.translation import translate
from instdrive_app.panels.widgets.theme import rgba
from instdrive_app.panels.widgets.ui import (
    Ui,
    draw_action_button,
    draw_dim_text,
    get_icon,
    make_icon_label,
    scale_pixels,
)
from instdrive_app.preferences.themes import ACCENT, DIM, ERROR, GOOD
from instdrive_app.session.making.job_controller import REPORT, JobController
from instdrive_core.datasets.photos import load_photo, read_photo_size
from instdrive_core.errors import DataError
from instdrive_core.jobs.job_file import PICTURE, JobStage, JobState, describe_seconds, locate_job_file
from instdrive_core.wording import phrase

PLOT_HEIGHT = 110.0
"""Pixels at scale 1."""
SMOOTHING = 0.8
"""Weight of what was before in the curves: single photos differ much."""
SHOWN_FIGURES = (
    ("psnr", "PSNR", "{:.2f} dB"),
    ("ssim", "SSIM", "{:.3f}"),
    ("n_gaussians", "Splats", "{:,.0f}"),
    ("n_instances", "Instances", "{:,.0f}"),
)
"""Keys, titles and forms of the figures shown of an evaluation."""


STATUSES = {
    "starting": phrase("starting"),
    "running": phrase("running"),
    "paused": phrase("paused"),
    "interrupted": phrase("interrupted"),
    "stopped": phrase("stopped"),
    "failed": phrase("failed"),
    "done": phrase("done"),
}
"""What the user reads of a job's state."""


class TrainingPanel:
    """Shows the job that the session follows."""

    def __init__(self) -> None:
        self._picture: tuple[tuple[Path, int], UInt8[ndarray, "h w 4"]] | None = None

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        making = ui.session.making
        if making.run is None:
            draw_action_button(ui, ui.session.actions["file.new"])
            imgui.same_line()
            draw_dim_text(translate("makes a scene of photos, a video or a drive"))
            return
        state = making.state
        imgui.push_font(ui.fonts.bold, 0.0)
        imgui.text(making.run.name)
        imgui.pop_font()
        imgui.same_line()
        draw_dim_text(translate(STATUSES[_describe_status(making)]))
        ui.mark(f"training.status.{_describe_status(making)}")
        _draw_buttons(ui, making)
        if state is None:
            draw_dim_text(translate("Starting…"))
            return
        if state.problem:
            _draw_wrapped(state.problem, error=True)
        for stage in state.stages:
            _draw_stage(state, stage)
        if state.status == "done":
            _draw_figures(making)
        self._draw_picture(ui, making.run, state)
        _draw_curves(ui, state)
        for note in state.notes:
            _draw_wrapped(note)

    def _draw_picture(self, ui: Ui, run: Path, state: JobState) -> None:
        if not state.pictures:
            return
        key = (run, state.pictures)
        if self._picture is None or self._picture[0] != key:
            picture = _read_picture(locate_job_file(run, PICTURE))
            if picture is None:
                return
            self._picture = key, picture
        picture = self._picture[1]
        width = imgui.get_content_region_avail().x
        size = ImVec2(width, width * picture.shape[0] / picture.shape[1])
        imgui.image(imgui.ImTextureRef(ui.textures.show("training", picture)), size)
        ui.mark("training.picture")
        draw_dim_text(translate("Left: as it is drawn now. Right: the photo."))


def _describe_status(making: JobController) -> str:
    state = making.state
    if state is None:
        return "starting"
    if making.is_interrupted and state.status in ("running", "paused"):
        return "interrupted"
    return state.status


def _draw_buttons(ui: Ui, making: JobController) -> None:
    state = making.state
    if making.is_running:
        held = state is not None and state.status == "paused"
        if _draw_button(ui, "Go on" if held else "Pause", "ICON_FA_PLAY" if held else "ICON_FA_PAUSE"):
            making.ask("run" if held else "pause")
        imgui.same_line()
        if _draw_button(ui, "Stop", "ICON_FA_STOP"):
            making.ask("stop")
        return
    if making.is_interrupted:
        if _draw_button(ui, "Resume", "ICON_FA_PLAY"):
            making.go_on()
        return
    if state is not None and state.status == "done":
        finds = state.request.kind == "find-objects"
        opens, icon = ("Use the objects", "ICON_FA_CUBES") if finds else ("Open the scene", "ICON_FA_FOLDER_OPEN")
        if _draw_button(ui, opens, icon):
            making.open_scene()
        if making.run is not None and (making.run / REPORT).is_file():
            imgui.same_line()
            if _draw_button(ui, "Report", "ICON_FA_CHART_COLUMN"):
                making.open_report()


def _draw_button(ui: Ui, title: str, icon: str) -> bool:
    pressed = imgui.button(make_icon_label(icon, title))
    ui.mark(f"training.{title}")
    return pressed


def _draw_stage(state: JobState, stage: JobStage) -> None:
    icons = {"done": ("ICON_FA_CHECK", GOOD), "running": ("ICON_FA_PLAY", ACCENT), "waiting": ("ICON_FA_MINUS", DIM)}
    icon, color = icons[stage.status]
    imgui.text_colored(rgba(color), get_icon(icon))
    imgui.same_line(2.2 * imgui.get_font_size())
    imgui.text(translate(stage.title))
    if stage.status == "done":
        imgui.same_line()
        draw_dim_text(translate(describe_seconds(stage.seconds)))
    if stage.status != "running":
        return
    imgui.same_line()
    if state.seconds_left is not None:
        draw_dim_text(translate("about {time} left", time=describe_seconds(state.seconds_left)))
    imgui.progress_bar(stage.share or 0.0, ImVec2(-1, scale_pixels(6)), "")
    if state.doing:
        _draw_wrapped(state.doing)


def _draw_figures(making: JobController) -> None:
    figures = making.figures
    known = [(key, title, form) for key, title, form in SHOWN_FIGURES if isinstance(figures.get(key), (int, float))]
    if known:
        imgui.push_text_wrap_pos(0)
        imgui.text(",  ".join(f"{translate(title)} {form.format(figures[key])}" for key, title, form in known))
        imgui.pop_text_wrap_pos()


def _draw_curves(ui: Ui, state: JobState) -> None:
    """PSNR and loss of the training's present stage."""
    if len(state.curve) < 2:
        return
    if implot.get_current_context() is None:
        implot.create_context()
    stage = state.curve[-1].stage
    points = [point for point in state.curve if point.stage == stage]
    steps = np.array([point.iteration for point in points], np.float64)
    psnr = [point.psnr for point in points if point.psnr is not None]
    if len(psnr) == len(points):
        _draw_plot(ui, "PSNR (dB)", steps, smooth_curve(np.array(psnr, np.float64)))
    _draw_plot(ui, "Loss", steps, smooth_curve(np.array([point.loss for point in points], np.float64)))


def _draw_plot(ui: Ui, title: str, steps: Float64[ndarray, " n"], values: Float64[ndarray, " n"]) -> None:
    flags = implot.Flags_.no_legend | implot.Flags_.no_inputs | implot.Flags_.no_menus
    if implot.begin_plot(f"{translate(title)}###curve {title}", ImVec2(-1, scale_pixels(PLOT_HEIGHT)), flags):
        fit = implot.AxisFlags_.auto_fit
        implot.setup_axes("", "", fit, fit)
        implot.plot_line(title, steps, values)
        implot.end_plot()
        ui.mark(f"training.curve.{title}")


def smooth_curve(values: Float64[ndarray, " n"]) -> Float64[ndarray, " n"]:
    """Smooth a curve by a running mean that forgets: `SMOOTHING` of it stays from point to point."""
    smooth = values.copy()
    for place in range(1, len(smooth)):
        smooth[place] = SMOOTHING * smooth[place - 1] + (1 - SMOOTHING) * values[place]
    return smooth


def _draw_wrapped(text: str, error: bool = False) -> None:
    imgui.push_text_wrap_pos(0)
    imgui.text_colored(rgba(ERROR if error else DIM), translate(text))
    imgui.pop_text_wrap_pos()


def _read_picture(file: Path) -> UInt8[ndarray, "h w 4"] | None:
    """The live picture in RGBA; None where it cannot be read just now."""
    try:
        size = read_photo_size(file)
        pixels = load_photo(file, size, size)
    except DataError:
        return None
    return np.dstack([pixels, np.full(pixels.shape[:2], 255, np.uint8)])
