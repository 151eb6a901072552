"""The stages of a job that finds the objects of a finished scene in photos and their masks."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from instdrive_core.datasets.clip import Clip
from instdrive_core.errors import DataError, EditError, OptionError
from instdrive_core.evaluation.run_facts import FACTS
from instdrive_core.files.atomic import write_bytes
from instdrive_core.files.json_fields import read_json, require_field
from instdrive_core.finding.learning import keep_masked_photos, learn_objects
from instdrive_core.finding.photo_likeness import GOOD_LIKENESS, choose_placement
from instdrive_core.finding.placement import list_placements, place_scene
from instdrive_core.finding.relabeling import plan_relabeling
from instdrive_core.finding.seen_objects import SeenObjects, identify_rows, read_seen_objects, write_seen_objects
from instdrive_core.jobs.desk import JobDesk
from instdrive_core.jobs.find_source import choose_mask_origin, locate_photos, open_photos
from instdrive_core.jobs.job_file import EDITS, JobRequest, JobStage, locate_job_file, locate_project
from instdrive_core.jobs.source import find_missing
from instdrive_core.jobs.stages import StageWork
from instdrive_core.masks.label_map_folder import open_masks
from instdrive_core.masks.making import make_masks
from instdrive_core.masks.photo_fit import describe_misfit
from instdrive_core.progress import report_to
from instdrive_core.project.cameras_beside import attach_cameras_beside
from instdrive_core.project.open import locate_project_base, open_document
from instdrive_core.project.save import is_project, save_project
from instdrive_core.project.sources import SceneSource, get_sources, open_scene_source
from instdrive_core.scene.scene import Scene
from instdrive_core.wording import format_count, phrase

_TAKEN = "taken.json"


def plan_finding_stages(request: JobRequest) -> tuple[JobStage, ...]:
    """Plan the stages of finding objects, and check before anything is written that it can be done.

    Raises OptionError where photos or masks are missing, DataError where something cannot be read.
    """
    if problem := find_missing("torch"):
        raise OptionError(problem)
    source = Path(request.source)
    scene = locate_scene(source)
    clip = open_photos(scene, locate_photos(scene, request.clip))
    choice = choose_mask_origin(scene, clip, request.masks)
    return tuple(
        JobStage(stage.name, stage.title) for stage in FINDING_STAGES if stage.name != "masks" or choice.folder is None
    )


def locate_scene(source: Path) -> Path:
    """Locate the scene that is a source, or that a project's edits are of. Raises DataError where there is none."""
    if not source.exists():
        raise DataError(source, "there is no such scene or project", "Check the path")
    return locate_project_base(source) if is_project(source) else source.absolute()


def _take(desk: JobDesk) -> None:
    """Find out where the scene, without edits, lies among the photos; the project may change while the job runs."""
    asked, kept = desk.state.request, locate_job_file(desk.run, EDITS)
    desk.advance("opening the scene")
    document, _ = open_document(kept if kept.is_file() else Path(asked.source))
    orientation, base = document.orientation, get_sources(document).base
    del document
    scene, source = open_scene_source(base.path, base.keep_every)
    attach_cameras_beside(scene, base.path)
    clip = open_photos(base.path, locate_photos(base.path, asked.clip))
    with report_to(lambda share: desk.advance("comparing the scene with the photos", share)):
        matrix, match = choose_placement(
            scene, clip, list_placements(scene, clip, orientation), str(base.path.resolve())
        )
    if match.likeness < GOOD_LIKENESS:
        desk.note(
            f"Scene and photos agree by {match.likeness:.2f} only: where the scene lies beside what they show, objects "
            "take in splats around them"
        )
    content = {
        "scene": str(source.path),
        "sha256": source.identity.sha256,
        "keep_every": source.keep_every,
        "clip": str(Path(clip.path).resolve()),
        "matrix": matrix.tolist(),
    }
    write_bytes(locate_job_file(desk.run, _TAKEN), json.dumps(content).encode())


def _open_taken_clip(desk: JobDesk) -> tuple[Path, Clip]:
    file = locate_job_file(desk.run, _TAKEN)
    content = read_json(file)
    scene = Path(require_field(file, content, "scene"))
    return scene, open_photos(scene, Path(require_field(file, content, "clip")))


def _open_taken_scene(desk: JobDesk, clip: Clip) -> tuple[Scene, SceneSource]:
    """Open the scene, in the clip's world. Raises DataError where it is no longer the same."""
    file = locate_job_file(desk.run, _TAKEN)
    content = read_json(file)
    scene, source = open_scene_source(
        Path(require_field(file, content, "scene")), require_field(file, content, "keep_every")
    )
    if source.identity.sha256 != require_field(file, content, "sha256"):
        raise DataError(source.path, "is no longer the scene that the job began with", "Find the objects again")
    return place_scene(scene, np.array(require_field(file, content, "matrix"), np.float64), clip.origin), source


def _make_masks(desk: JobDesk) -> None:
    scene, clip = _open_taken_clip(desk)
    choice, total = choose_mask_origin(scene, clip, desk.state.request.masks), max(len(clip.training_frames), 1)

    def show(done: int) -> None:
        desk.advance(f"masks of {total} photos", done / total)

    made = make_masks(clip, choice.source, desk.run / "masks", on_frame=show, options=choice.options)
    desk.note(f"{sum(made.counts.values()):,} masks in {len(made.counts)} photos")


def _learn(desk: JobDesk) -> None:
    path, clip = _open_taken_clip(desk)
    choice = choose_mask_origin(path, clip, desk.state.request.masks)
    masks = open_masks(desk.run / "masks" if choice.folder is None else choice.folder)
    misfit = describe_misfit(keep_masked_photos(clip, masks), masks)
    if misfit is not None:
        desk.note(misfit)
    scene, source = _open_taken_scene(desk, clip)
    if (source.path if source.path.is_dir() else source.path.parent).joinpath(FACTS).is_file():
        clip = clip.with_cameras(scene.views)  # where training found them
    with report_to(lambda share: desk.advance("looking at the masks", share)):
        learned = learn_objects(scene, clip, masks, desk.advance)
    found = SeenObjects(learned.numbers, learned.classes, learned.photos, identify_rows(source))
    write_seen_objects(desk.run, found)
    photos = format_count(found.photos, "photo")
    desk.note(f"{format_count(len(found.classes), 'object')} in the masks of {photos}")


def _keep(desk: JobDesk) -> None:
    """Write a project with the objects, for whoever is not an editor that waits for them."""
    asked, kept = desk.state.request, locate_job_file(desk.run, EDITS)
    desk.advance("writing the project")
    document, view = open_document(kept if kept.is_file() else Path(asked.source))
    try:
        document.apply(plan_relabeling(document, read_seen_objects(desk.run), asked.replaces))
    except EditError as error:
        desk.note(str(error))
        return
    save_project(locate_project(desk.run), document, view)


FINDING_STAGES = (
    StageWork("take", phrase("Scene and photos"), lambda facts: True, _take),
    StageWork("masks", phrase("Masks"), lambda facts: True, _make_masks),
    StageWork("learn", phrase("Objects"), lambda facts: True, _learn),
    StageWork("keep", phrase("Edits"), lambda facts: True, _keep),
)
"""All stages in order."""
