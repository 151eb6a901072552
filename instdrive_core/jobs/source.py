"""What a folder or file is that somebody wants a scene of, and what it has: photos, LiDAR, boxes, masks."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

from instdrive_core.datasets.capture.candidates import PHOTOS, VIDEOS, list_photo_files
from instdrive_core.datasets.capture.choice import FEWEST
from instdrive_core.datasets.clip import Clip, ClipOptions
from instdrive_core.datasets.clip_facts import list_clip_facts
from instdrive_core.datasets.photos import read_photo_size
from instdrive_core.datasets.registry import find_data_set
from instdrive_core.errors import DataError
from instdrive_core.extras import explain_missing_module
from instdrive_core.masks.annotated.labels import has_annotations
from instdrive_core.masks.exact import has_exact_labels
from instdrive_core.masks.label_map_folder import SIDECAR
from instdrive_core.wording import format_count, phrase

SourceKind = Literal["clip", "photos", "video"]
MaskPlan = Literal["own", "exact", "annotations", "lidar", "sam", "none"]
_MASK_WORDS: dict[MaskPlan, str] = {
    "own": phrase("there already, used as they are"),
    "exact": phrase("made from the synthetic clip's labels"),
    "annotations": phrase("made from boxes, classes and LiDAR"),
    "lidar": phrase("made from LiDAR and photos"),
    "sam": phrase("made by Segment Anything"),
    "none": phrase(
        "none; without them nothing can be clicked (Segment Anything makes some: pip install 'instdrive[sam]')"
    ),
}


@dataclass(frozen=True)
class SourceFacts:
    """What a scene can be made of."""

    kind: SourceKind
    title: str
    """Words on what it is."""
    facts: tuple[tuple[str, str], ...]
    """Labels and texts."""
    masks: MaskPlan
    """Where masks come from."""
    finds_tracks: bool
    """Whether moving objects are looked for in LiDAR sweeps."""
    problem: str = ""
    """Why nothing can be made of it on this machine; empty where something can."""
    mask_plans: tuple[MaskPlan, ...] = ()
    """All places that a clip's masks can come from, the best first."""


def look_at_source(source: Path) -> SourceFacts:
    """Look at a folder or video.

    Raises DataError where it is neither a data set, nor a folder of photos, nor a video, or where a file is damaged.
    """
    data_set = find_data_set(str(source))
    if data_set is not None:
        clip = data_set.load(str(source), ClipOptions(scale=1.0))
        plans = list_mask_plans(clip)
        masks = plans[0] if plans else "none"
        facts = (*list_clip_facts(data_set.title, clip), (phrase("masks"), _MASK_WORDS[masks]))
        finds = bool(clip.sweeps) and not clip.tracks
        return SourceFacts(
            "clip", phrase("{name} clip", name=data_set.title), facts, masks, finds, find_missing("torch"), plans
        )
    if source.is_dir() and any(file.suffix.lower() in PHOTOS for file in source.iterdir()):
        return _look_at_photos(source)
    if source.is_file() and source.suffix.lower() in VIDEOS:
        masks = choose_photo_masks()
        facts = ((phrase("video"), f"{source.stat().st_size / 1e6:,.1f} MB"), (phrase("masks"), _MASK_WORDS[masks]))
        return SourceFacts("video", phrase("Video"), facts, masks, False, find_missing("torch", "cv2", "pycolmap"))
    problem = "is no data set, no folder of photos and no video" if source.exists() else "was not found"
    remedy = f"Choose a clip's folder, a folder of photos ({', '.join(PHOTOS)}), or a video ({', '.join(VIDEOS)})"
    raise DataError(source, problem, remedy)


def choose_masks(clip: Clip) -> MaskPlan:
    """Choose where a clip's masks come from: the best that it has what is needed for."""
    plans = list_mask_plans(clip)
    return plans[0] if plans else "none"


def describe_masks(plan: MaskPlan) -> str:
    """Say where masks come from."""
    return _MASK_WORDS[plan]


def list_mask_plans(clip: Clip) -> tuple[MaskPlan, ...]:
    """List all places that a clip's masks can come from, the best first."""
    there: tuple[tuple[MaskPlan, bool], ...] = (
        ("own", (Path(clip.path) / "masks" / SIDECAR).is_file()),
        ("exact", has_exact_labels(clip.path)),
        ("annotations", has_annotations(clip)),
        ("lidar", bool(clip.training_sweeps)),
        ("sam", choose_photo_masks() == "sam"),
    )
    return tuple(plan for plan, is_there in there if is_there)


def choose_photo_masks() -> MaskPlan:
    """Choose where masks of photos alone come from: Segment Anything where it is installed, else nowhere."""
    return "none" if find_missing("torch", "transformers") else "sam"


def find_missing(*packages: str) -> str:
    """Say what to install where one of some packages is missing; empty where all are there."""
    for package in packages:
        if find_spec(package) is None:
            return str(explain_missing_module(ModuleNotFoundError(name=package)))
    return ""


def _look_at_photos(source: Path) -> SourceFacts:
    files = list_photo_files(source)
    masks, (width, height) = choose_photo_masks(), read_photo_size(files[0])
    facts = (
        (
            phrase("photos"),
            phrase("{count:,}, the first of {width}×{height}", count=len(files), width=width, height=height),
        ),
        (phrase("masks"), _MASK_WORDS[masks]),
    )
    problem = find_missing("torch", "cv2", "pycolmap")
    if len(files) < FEWEST:
        problem = f"{format_count(len(files), 'photo')}: at least {FEWEST} are needed, taken from places apart"
    return SourceFacts("photos", phrase("Folder of photos"), facts, masks, False, problem)
