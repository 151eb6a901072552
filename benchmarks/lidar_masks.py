"""Quality and speed of the masks that need no weights, against a clip's exact or annotated ones.

`python -m benchmarks.lidar_masks CLIP` makes the masks of all training photos with `masks/lidar.py` and prints one
JSON line. Things are compared by the best IoU that any mask reaches, everything by one-to-one matches in each photo;
instances under 100 pixels in a photo are ignored, as in the evaluation.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import tyro
from jaxtyping import Bool, Float64, UInt8, UInt32
from numpy import ndarray
from PIL import Image
from tyro.conf import Positional

from instdrive_core.datasets.clip import Clip, ClipOptions, Frame
from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import InstDriveError
from instdrive_core.evaluation.metrics.segmentation import count_confusion, match_one_to_one, prepare_truth
from instdrive_core.masks.annotated.labels import AnnotationLabels
from instdrive_core.masks.exact import ExactLabels, has_exact_labels
from instdrive_core.masks.ground_truth import GroundTruth
from instdrive_core.masks.label_source import LabelSource
from instdrive_core.masks.lidar.labels import LidarLabels

PICTURE_WIDTH = 960


@dataclass(frozen=True)
class Options:
    """Compare masks made from LiDAR with what the clip knows."""

    clip: Positional[Path]
    every: int = 1
    """Only every so many-th training photo."""
    picture: Path | None = None
    """Also write a picture: photos, masks and ground truth of a step in the middle of the clip."""
    options: ClipOptions = field(default_factory=ClipOptions)


@dataclass(frozen=True)
class PhotoScores:
    """One photo's figures, an entry for each ground-truth instance."""

    is_thing: ndarray
    best_iou: Float64[ndarray, " t"]
    matched_iou: Float64[ndarray, " t"]
    masks: int
    """Predicted masks that do not lie mostly on ignored ground."""
    sky_iou: float | None


def open_truth(clip: Clip) -> GroundTruth:
    """Exact labels, else ones made of the annotations that may train."""
    return ExactLabels(clip.path) if has_exact_labels(clip.path) else AnnotationLabels(clip, held_out=False)


def score_photo(truth: GroundTruth, masks: LabelSource, frame: Frame) -> PhotoScores | None:
    """Compare one photo's masks; None where nothing is known of it."""
    expected = prepare_truth(truth.load(frame), None if frame.valid is None else ~frame.valid)
    pixels = count_confusion(expected.astype(np.int64), masks.load(frame).astype(np.int64))
    if not len(pixels.truth_ids):
        return None
    things = {number for number, one in truth.instances.items() if one.kind == "thing"}
    sky = truth.load_sky(frame)
    return PhotoScores(
        np.isin(pixels.truth_ids, list(things)),
        pixels.iou.max(axis=1, initial=0),
        match_one_to_one(pixels).iou,
        int((pixels.predicted_areas >= pixels.ignored_areas).sum()),
        None if sky is None or not sky.any() else _iou(sky, masks.load_sky(frame)),
    )


def compute_figures(photos: Sequence[PhotoScores]) -> dict[str, float]:
    """Means over photos, things and masks."""
    is_thing = np.concatenate([one.is_thing for one in photos])
    best = np.concatenate([one.best_iou for one in photos])
    matched = np.concatenate([one.matched_iou for one in photos])
    hits, masks = matched > 0.5, sum(one.masks for one in photos)
    return {
        "things_best_iou": float(best[is_thing].mean()) if is_thing.any() else 0.0,
        "things_iou50": float((best[is_thing] > 0.5).mean()) if is_thing.any() else 0.0,
        "stuff_best_iou": float(best[~is_thing].mean()) if (~is_thing).any() else 0.0,
        "per_view_miou": float(np.mean([one.matched_iou.mean() for one in photos])),
        "pq": float(matched[hits].sum() / ((len(matched) + masks) / 2)),
        "sky_iou": float(np.mean([one.sky_iou for one in photos if one.sky_iou is not None] or [0.0])),
        "masks_per_photo": masks / len(photos),
        "things_per_photo": float(is_thing.sum()) / len(photos),
    }


def draw_picture(truth: GroundTruth, masks: LabelSource, frames: Sequence[Frame]) -> UInt8[ndarray, "h w 3"]:
    """A row for each photo: the photo, the masks, the ground truth."""
    rows = []
    for frame in frames:
        image, sky = frame.load_image(), truth.load_sky(frame)
        own = _paint(image, masks.load(frame), masks.load_sky(frame))
        known = _paint(image, truth.load(frame), np.zeros(image.shape[:2], bool) if sky is None else sky)
        rows.append(np.hstack([image, own, known]))
    return np.vstack(rows)


def _paint(
    image: UInt8[ndarray, "h w 3"], labels: UInt32[ndarray, "h w"], sky: Bool[ndarray, "h w"]
) -> UInt8[ndarray, "h w 3"]:
    """A photo under its masks, with white borders."""
    palette = np.random.default_rng(1).integers(40, 256, (int(labels.max(initial=0)) + 1, 3))
    shown = np.where((labels > 0)[..., None], 0.4 * image + 0.6 * palette[labels], image)
    shown[sky] = 0.4 * image[sky] + 0.6 * np.array([100, 200, 255])
    border = np.zeros(labels.shape, bool)
    border[:, 1:] |= labels[:, 1:] != labels[:, :-1]
    border[1:] |= labels[1:] != labels[:-1]
    shown[border] = 255
    return shown.astype(np.uint8)


def main(options: Options) -> dict[str, object]:
    """Everything the JSON line says."""
    clip = load_clip(str(options.clip), options.options)
    start = time.perf_counter()
    masks = LidarLabels(clip)
    prepared = time.perf_counter()
    frames = clip.training_frames[:: options.every]
    for frame in frames[:1]:
        masks.load(frame)  # compiles
    truth, photos, seconds = open_truth(clip), [], 0.0
    for frame in frames:
        begun = time.perf_counter()
        masks.load(frame)
        seconds += time.perf_counter() - begun
        scores = score_photo(truth, masks, frame)
        if scores is not None:
            photos.append(scores)
    if options.picture is not None:
        middle = frames[len(frames) // 2].view.index
        shown = [frame for frame in clip.training_frames if frame.view.index == middle]
        Image.fromarray(draw_picture(truth, masks, shown)).resize(
            (PICTURE_WIDTH, round(PICTURE_WIDTH / 3 * 9 / 16) * len(shown)), Image.Resampling.LANCZOS
        ).save(options.picture, quality=80)
    return {
        "clip": clip.name,
        "truth": truth.source,
        "photos": len(photos),
        **{name: round(value, 4) for name, value in compute_figures(photos).items()},
        "scene_seconds": round(prepared - start, 2),
        "seconds_per_photo": round(seconds / max(1, len(frames)), 3),
    }


def _iou(one: ndarray, other: ndarray) -> float:
    return float((one & other).sum() / max(1, (one | other).sum()))


if __name__ == "__main__":
    try:
        print(json.dumps(main(tyro.cli(Options))))
    except InstDriveError as error:
        sys.exit(str(error))
