"""The stages of a job that trains on from an edited scene."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool
from numpy import ndarray
from safetensors import SafetensorError
from safetensors.numpy import load, save

from instdrive_core.errors import DataError, OptionError
from instdrive_core.files.atomic import write_bytes
from instdrive_core.files.json_fields import read_json, require_field
from instdrive_core.improving.base import BaseRun, locate_base_run, open_base_run
from instdrive_core.improving.improvement import Improvement, run_improvement
from instdrive_core.improving.settings import build_improving_config
from instdrive_core.improving.timing import measure_improving_step
from instdrive_core.jobs.desk import JobDesk
from instdrive_core.jobs.job_file import EDITS, JobStage, describe_seconds, locate_job_file, locate_project
from instdrive_core.jobs.pacing import choose_pace
from instdrive_core.jobs.stages import STAGES, StageWork, report_event
from instdrive_core.progress import report_to
from instdrive_core.project.carrying.carried_project import carry_project
from instdrive_core.project.carrying.edited_rows import find_edited_rows
from instdrive_core.project.open import open_project
from instdrive_core.project.save import is_project, save_project
from instdrive_core.project.sources import get_sources
from instdrive_core.training.run import FACTS
from instdrive_core.wording import format_count, phrase

_TAKEN, _ROWS = "taken.json", "edited.safetensors"
_ARRAY = "edited"


@dataclass(frozen=True)
class _Taken:
    """What the job goes on from, found out once."""

    base: BaseRun
    edited: Bool[ndarray, " n"]
    """Rows of the base that were deleted, moved or recoloured."""


def plan_improving_stages(evaluate: bool) -> tuple[JobStage, ...]:
    """Plan the stages of training on."""
    return tuple(JobStage(stage.name, stage.title) for stage in IMPROVING_STAGES if evaluate or stage.name != "eval")


def check_improving(source: Path, clip: str) -> None:
    """Check, before anything is written, that a run or a project can be trained on.

    Raises OptionError where it is no run of this program, DataError where it or its clip cannot be read.
    """
    if not source.exists():
        raise DataError(source, "there is no such run or project", "Check the path")
    if not is_project(source):
        open_base_run(locate_base_run(source), Path(clip) if clip else None)


def _take(desk: JobDesk) -> None:
    """Keep the edits as they are now, and note which rows they touch: the project may change while the job runs."""
    asked, kept = desk.state.request, locate_job_file(desk.run, EDITS)
    source = Path(asked.source)
    desk.advance("opening the scene")
    edited, place = None, source
    if kept.is_file() or is_project(source):
        project = open_project(kept if kept.is_file() else source)
        for note in project.notes:
            desk.note(note)
        document = project.document
        place = get_sources(document).base.path
        if get_sources(document).base.keep_every != 1:
            raise OptionError(f"{source}: only a part of its scene is open. Open all of it.")
        base = open_base_run(locate_base_run(place), Path(asked.clip) if asked.clip else None)
        edited = find_edited_rows(document, len(base.scene))
        if not kept.is_file():
            save_project(kept, document, project.view)
    else:
        base = open_base_run(locate_base_run(place), Path(asked.clip) if asked.clip else None)
    edited = np.zeros(len(base.scene), bool) if edited is None else edited
    if edited.any():
        splats = format_count(int(edited.sum()), "splat")
        desk.note(f"{splats} were deleted, moved or recoloured: they stay as they are")
    write_bytes(locate_job_file(desk.run, _ROWS), save({_ARRAY: edited.astype(np.uint8)}))
    content = {"base": str(base.run.resolve()), "clip": str(Path(base.clip.path).resolve())}
    write_bytes(locate_job_file(desk.run, _TAKEN), json.dumps(content).encode())


def _open_taken(desk: JobDesk) -> _Taken:
    file, rows = locate_job_file(desk.run, _TAKEN), locate_job_file(desk.run, _ROWS)
    content = read_json(file)
    base = open_base_run(Path(require_field(file, content, "base")), Path(require_field(file, content, "clip")))
    try:
        edited = load(rows.read_bytes())[_ARRAY].astype(bool)
    except (OSError, SafetensorError, KeyError) as error:
        raise DataError(rows, f"cannot be read ({error})", "Begin the job in another folder") from error
    if edited.shape != (len(base.scene),):
        raise DataError(base.run, "its scene is not the one that the job began with", "Begin the job in another folder")
    return _Taken(base, edited)


def _measure_pace(desk: JobDesk) -> None:
    asked = desk.state.request
    if asked.iterations is not None:
        desk.change(iterations=asked.iterations)
        return
    desk.advance("timing some steps on this machine")
    base = _open_taken(desk).base
    spent = sum(stage.seconds for stage in desk.state.stages)
    pace = choose_pace(measure_improving_step(base, on_note=desk.advance), asked.minutes, spent)
    looks = pace.iterations / len(base.clip.training_frames)
    each = f"each of {len(base.clip.training_frames):,} photos is seen {looks:.0f} more times"
    desk.note(f"{pace.iterations:,} steps: {each}; expected in {describe_seconds(pace.seconds)}")
    desk.change(iterations=pace.iterations)


def _train_on(desk: JobDesk) -> None:
    iterations = desk.state.iterations
    if iterations is None:
        raise OptionError(f"{desk.run}: the number of training steps is not known. Begin the job in another folder.")
    if (desk.run / FACTS).is_file():
        return
    taken = _open_taken(desk)
    config = build_improving_config(taken.base.clip, len(taken.base.scene), iterations)
    if desk.state.request.checkpoint_every is not None:
        config = replace(config, checkpoint_every=desk.state.request.checkpoint_every)
    request = Improvement(taken.base, desk.run, config, taken.edited)
    with report_to(lambda share: desk.advance(desk.state.doing, share)):
        run_improvement(request, lambda event: report_event(desk, event), lambda note: desk.advance(note))


def _carry_edits(desk: JobDesk) -> None:
    kept = locate_job_file(desk.run, EDITS)
    if not kept.is_file():
        return
    desk.advance("making the edits again")
    carried = carry_project(kept, desk.run, locate_project(desk.run))
    for note in carried.notes:
        desk.note(note)
    desk.note(f"{format_count(carried.count, 'edit')} on the improved scene: {locate_project(desk.run)}")


IMPROVING_STAGES = (
    StageWork("take", phrase("Scene and edits"), lambda facts: True, _take),
    StageWork("pace", phrase("Timing"), lambda facts: True, _measure_pace),
    StageWork("train", phrase("Training"), lambda facts: True, _train_on),
    StageWork("carry", phrase("Edits"), lambda facts: True, _carry_edits),
    next(stage for stage in STAGES if stage.name == "eval"),
)
"""All stages in order."""
