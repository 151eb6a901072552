"""The stages of a job, and which of them a source needs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from PIL import Image

from instdrive_core.datasets.capture.prepare import Preparation, prepare_clip
from instdrive_core.datasets.clip import Clip, ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import InstDriveError, OptionError
from instdrive_core.evaluation.comparison import EVALUATED
from instdrive_core.evaluation.page.report import write_report
from instdrive_core.evaluation.protocol import evaluate_run
from instdrive_core.evaluation.tables import write_figures
from instdrive_core.files.atomic import open_atomically
from instdrive_core.jobs.desk import JobDesk
from instdrive_core.jobs.job_file import PICTURE, CurvePoint, JobStage, describe_seconds, locate_job_file
from instdrive_core.jobs.pacing import build_paced_config, choose_pace, describe_pace, measure_step_seconds
from instdrive_core.jobs.source import SourceFacts, choose_masks
from instdrive_core.masks.making import make_masks
from instdrive_core.progress import CancelledError, report_to
from instdrive_core.tracks.choice import choose_kept_tracks
from instdrive_core.training.pieces.drive import run_drive
from instdrive_core.training.run import CONFIG, FACTS, RunRequest
from instdrive_core.training.settings.events import Event, StageStarted, StepDone, ViewDrawn
from instdrive_core.training.views.photo_depth import expect_comparing_seconds
from instdrive_core.wording import phrase

REPORT = "report.html"
_PICTURE_WIDTH = 960


@dataclass(frozen=True)
class StageWork:
    """One kind of stage."""

    name: str
    title: str
    is_needed: Callable[[SourceFacts], bool]
    work: Callable[[JobDesk], None]
    """Does the stage, or what is left of it; raises JobStoppedError where the job is to stop."""


def plan_stages(facts: SourceFacts, evaluate: bool) -> tuple[JobStage, ...]:
    """Plan the stages that a source needs."""
    needed = [stage for stage in STAGES if stage.is_needed(facts) and (evaluate or stage.name != "eval")]
    return tuple(JobStage(stage.name, stage.title) for stage in needed)


def locate_clip(desk: JobDesk) -> Path:
    """Locate the clip that a job trains: its source, or what was prepared of that."""
    is_prepared = any(stage.name == "prepare" for stage in desk.state.stages)
    return desk.run / "clip" if is_prepared else Path(desk.state.request.source)


def _open_clip(desk: JobDesk) -> Clip:
    return load_clip(str(locate_clip(desk)), ClipOptions())


def _prepare(desk: JobDesk) -> None:
    def show(doing: str, done: int, total: int) -> None:
        desk.advance(doing, done / total if total else None)

    found = prepare_clip(Preparation(Path(desk.state.request.source), desk.run / "clip"), show)
    if found is not None:
        listed = sum(1 for _ in (desk.run / "clip" / "images").iterdir())
        desk.note(f"{found.photos} of {listed} photos have poses, {found.error:.2f} px mean error")


def _make_masks(desk: JobDesk) -> None:
    clip = _open_clip(desk)
    source, total = choose_masks(clip), max(len(clip.training_frames), 1)
    if source in ("own", "none"):
        return

    def show(done: int) -> None:
        desk.advance(f"masks of {total} photos", done / total)

    try:
        made = make_masks(clip, source, desk.run / "masks", on_frame=show)
    except CancelledError:
        raise
    except InstDriveError as error:
        if source != "sam":
            raise
        desk.note(f"There are no masks, so nothing in the scene can be clicked: {error}")
        return
    desk.note(f"{sum(made.counts.values()):,} masks in {len(made.counts)} photos")


def _find_tracks(desk: JobDesk) -> None:
    clip = _open_clip(desk)
    found = choose_kept_tracks(clip, desk.run, desk.advance)
    desk.note(f"{len(found.tracks)} moving objects found in the LiDAR sweeps")


def _measure_pace(desk: JobDesk) -> None:
    clip, asked = _open_clip(desk), desk.state.request
    if asked.iterations is not None:
        desk.change(iterations=asked.iterations)
        return
    desk.advance("timing some steps on this machine")
    spent = sum(stage.seconds for stage in desk.state.stages) + expect_comparing_seconds(clip)
    pace = choose_pace(measure_step_seconds(clip, on_note=desk.advance), asked.minutes, spent)
    desk.note(f"{describe_pace(pace, len(clip.training_frames))}; expected in {describe_seconds(pace.seconds)}")
    desk.change(iterations=pace.iterations)


def _train(desk: JobDesk) -> None:
    iterations = desk.state.iterations
    if iterations is None:
        raise OptionError(f"{desk.run}: the number of training steps is not known. Begin the job in another folder.")
    if (desk.run / FACTS).is_file():
        return
    config = build_paced_config(_open_clip(desk), iterations)
    if desk.state.request.checkpoint_every is not None:
        config = replace(config, checkpoint_every=desk.state.request.checkpoint_every)
    masks = desk.run / "masks"
    request = RunRequest(
        locate_clip(desk),
        desk.run,
        ClipOptions(),
        config,
        masks if (masks / "masks.json").is_file() else None,
        resume=(desk.run / CONFIG).is_file(),
        pieces="auto",
    )
    with report_to(lambda share: desk.advance(desk.state.doing, share)):
        run_drive(request, lambda event: report_event(desk, event), lambda note: desk.advance(note))


def report_event(desk: JobDesk, event: Event) -> None:
    """Pass on what a trainer reports: figures, curves and pictures. Raises JobStoppedError where the job is to stop."""
    if isinstance(event, StageStarted):
        desk.advance("colour and shape" if event.stage == "rgb" else "instances", event.iteration / max(event.total, 1))
    elif isinstance(event, StepDone):
        desk.add_point(CurvePoint(event.stage, event.iteration, event.loss, event.psnr))
        name = "colour and shape" if event.stage == "rgb" else "instances"
        figures = f"step {event.iteration:,} of {event.total:,}, {event.gaussians:,} splats"
        desk.advance(f"{name}: {figures}", event.iteration / event.total)
    elif isinstance(event, ViewDrawn):
        _write_picture(desk, event)


def _write_picture(desk: JobDesk, event: ViewDrawn) -> None:
    """Write what was drawn, and its photo to the right."""
    height, width = event.drawn.shape[:2]
    both = Image.new("RGB", (2 * width, height))
    both.paste(Image.fromarray(event.drawn), (0, 0))
    both.paste(Image.fromarray(event.photo), (width, 0))
    both.thumbnail((_PICTURE_WIDTH, _PICTURE_WIDTH))
    with open_atomically(locate_job_file(desk.run, PICTURE)) as file:
        both.save(file, format="JPEG", quality=88)
    desk.change(pictures=desk.state.pictures + 1)


def _evaluate(desk: JobDesk) -> None:
    if (desk.run / EVALUATED).is_file() and (desk.run / REPORT).is_file():
        return

    def show(stage: str, done: int, total: int) -> None:
        desk.advance(stage, done / total if total else None)

    try:
        evaluation = evaluate_run(desk.run, show)
    except CancelledError:
        raise
    except InstDriveError as error:
        desk.note(f"The scene is there but was not measured: {error}")
        return
    desk.advance("writing the report")
    write_report(desk.run / REPORT, desk.run, evaluation)
    write_figures(desk.run / EVALUATED, evaluation.figures)


STAGES = (
    StageWork("prepare", phrase("Poses of the photos"), lambda facts: facts.kind != "clip", _prepare),
    StageWork("masks", phrase("Masks"), lambda facts: facts.masks not in ("own", "none"), _make_masks),
    StageWork("tracks", phrase("Moving objects"), lambda facts: facts.finds_tracks, _find_tracks),
    StageWork("pace", phrase("Timing"), lambda facts: True, _measure_pace),
    StageWork("train", phrase("Training"), lambda facts: True, _train),
    StageWork("eval", phrase("Evaluation"), lambda facts: True, _evaluate),
)
"""All stages in order. A new one is a line here."""
