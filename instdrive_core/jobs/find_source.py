"""The photos and masks that objects of a finished scene are found in, and what is said of them before that begins."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from instdrive_core.datasets.clip import Clip, ClipOptions
from instdrive_core.datasets.clip_facts import list_clip_facts
from instdrive_core.datasets.registry import find_data_set, load_clip
from instdrive_core.errors import DataError, OptionError
from instdrive_core.evaluation.run_facts import FACTS, build_clip_options, read_run_facts
from instdrive_core.finding.clip_of_cameras import find_inria_cameras, open_clip_of_cameras
from instdrive_core.finding.known_photos import find_known_photos
from instdrive_core.improving.base import MASK_FOLDER
from instdrive_core.jobs.source import MaskPlan, SourceFacts, describe_masks, find_missing, list_mask_plans
from instdrive_core.masks.label_map_folder import SIDECAR, MaskFolder, open_masks
from instdrive_core.masks.sources import SourceOptions
from instdrive_core.wording import phrase

MADE: tuple[MaskPlan, ...] = ("exact", "annotations", "lidar", "sam")
"""Sources that a request can name in place of a folder."""


@dataclass(frozen=True)
class MaskOrigin:
    """Where the masks come from: a finished folder, or a source that makes them."""

    folder: Path | None = None
    source: str = ""
    options: SourceOptions = SourceOptions()  # noqa: RUF009 (frozen)


def look_at_photos(scene: Path, photos: Path) -> SourceFacts:
    """Look at photos in which the objects of a scene are to be found.

    Raises DataError where they have no poses, or a file is damaged.
    """
    clip = open_photos(scene, locate_photos(scene, str(photos)))
    data_set = find_data_set(str(photos))
    title = "3DGS" if data_set is None else data_set.title
    own = _find_finished_masks(scene, clip)
    plans: tuple[MaskPlan, ...] = tuple(plan for plan in list_mask_plans(clip) if plan != "own")
    plans = plans if own is None else ("own", *plans)
    facts = (*list_clip_facts(title, clip), (phrase("masks"), describe_masks(plans[0] if plans else "none")))
    found = phrase("{name} clip", name=title)
    return SourceFacts("clip", found, facts, plans[0] if plans else "none", False, find_missing("torch"), plans)


def locate_photos(scene: Path, asked: str) -> Path:
    """Locate the photos of a scene: those asked for, or those that it tells of where `asked` is empty.

    Raises OptionError where it tells of none, DataError where there is no such folder, or its photos have no poses.
    """
    photos = Path(asked) if asked else find_known_photos(scene)
    if photos is None:
        raise OptionError(
            f"{scene}: nothing tells which photos show it. Name the folder with photos and poses: --photos"
        )
    if not photos.exists():
        raise DataError(photos, "there is no such folder", "Choose the folder with photos and poses of the scene")
    if find_data_set(str(photos)) is None and find_inria_cameras(scene) is None:
        raise DataError(
            photos,
            "holds no photos with poses that this program reads",
            "Choose what the scene was trained with: a COLMAP model, nerfstudio's transforms.json, or a drive",
        )
    return photos


def open_photos(scene: Path, photos: Path) -> Clip:
    """Open the photos of a scene: the part that its run was trained on where they are the run's clip, else all.

    Photos without poses have those of the ``cameras.json`` beside the scene. Raises DataError where a file is damaged.
    """
    run, options = scene if scene.is_dir() else scene.parent, ClipOptions()
    if (run / FACTS).is_file():
        facts = read_run_facts(run)
        if Path(facts["clip"]).resolve() == photos.resolve():
            options = build_clip_options(facts)
    cameras = find_inria_cameras(scene)
    if find_data_set(str(photos)) is None and cameras is not None:
        clip = open_clip_of_cameras(cameras, photos, options)
    else:
        clip = load_clip(str(photos), options)
    if not clip.training_frames:
        raise DataError(photos, "no photo of a training time step was found", "Choose a folder with more photos")
    return clip


def choose_mask_origin(scene: Path, clip: Clip, asked: str) -> MaskOrigin:
    """Choose what was asked for, else the clip's own masks, those of the scene's run, or the best that can be made.

    Raises DataError where a folder is not there or damaged, OptionError where nothing can make masks.
    """
    if asked in MADE:
        return MaskOrigin(source=asked)
    if asked and asked != "own":
        folder = Path(asked)
        if not folder.is_dir():
            raise DataError(folder, "there is no such folder", "Choose the folder with a label map for each photo")
        if (folder / SIDECAR).is_file():
            return MaskOrigin(folder)
        return MaskOrigin(source="import", options=SourceOptions(imported=folder))
    finished = _find_finished_masks(scene, clip)
    if finished is not None:
        return MaskOrigin(finished)
    plan = next((plan for plan in list_mask_plans(clip) if plan in MADE), None)
    if plan is None:
        raise OptionError(
            f"{clip.path}: there are no masks, and nothing to make them of. Choose a folder with a label map for each "
            "photo (--masks), or let Segment Anything make them: pip install 'instdrive[sam]'"
        )
    return MaskOrigin(source=plan)


def _find_finished_masks(scene: Path, clip: Clip) -> Path | None:
    folders = (Path(clip.path) / "masks", *_list_run_masks(scene))
    there = (folder for folder in folders if (folder / SIDECAR).is_file())
    return next((folder for folder in there if _hold_photos(open_masks(folder), clip)), None)


def _list_run_masks(scene: Path) -> list[Path]:
    run = scene if scene.is_dir() else scene.parent
    if not (run / FACTS).is_file():
        return []
    named = read_run_facts(run).get(MASK_FOLDER)
    return [*([Path(named)] if isinstance(named, str) else []), run / "masks"]


def _hold_photos(masks: MaskFolder, clip: Clip) -> bool:
    return any(frame.key in masks.counts for frame in clip.training_frames)
