"""A long drive, trained in pieces and measured as one scene: `python -m benchmarks.long_drive` prints one JSON line.

Records a synthetic street of 300 steps, some 200 m, with exact masks, unless --clip names a drive.
`id_switches_across_borders` counts the objects whose main ID in the held-out photos of one piece's own stretch is
another in those of the next. Photos within `NEAR` metres of a border are compared with all others. A run that was
stopped goes on with the same call and --folder.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.datasets.synthetic.config import StreetConfig
from instdrive_core.datasets.synthetic.write import write_street
from instdrive_core.errors import InstDriveError
from instdrive_core.evaluation.metrics.held_out import HeldOutView
from instdrive_core.evaluation.metrics.segmentation import count_confusion
from instdrive_core.evaluation.protocol import Evaluation, evaluate_scene
from instdrive_core.evaluation.run_facts import read_run_facts
from instdrive_core.formats.folder.scenes import read_scene_folder
from instdrive_core.masks.faults.registry import FaultModel
from instdrive_core.masks.ground_truth import find_ground_truth
from instdrive_core.masks.label_map_folder import SIDECAR
from instdrive_core.masks.making import make_masks
from instdrive_core.training.pieces.cut import list_steps
from instdrive_core.training.pieces.drive import run_drive
from instdrive_core.training.pieces.plan import measure_drive
from instdrive_core.training.run import CONFIG, RunRequest
from instdrive_core.training.settings.clip_size import AskedSizes
from instdrive_core.training.settings.config import PieceChoice, Preset, build_train_config

NEAR = 8.0
"""Metres from a border."""
STREET = "street"
_RECORDED = "labels/instances.json"


@dataclass(frozen=True)
class Options:
    """Train and measure a long drive."""

    clip: Path | None = None
    """A drive; default: a synthetic street is recorded."""
    folder: Path | None = None
    """Where street and run are kept; default: a temporary folder."""
    steps: int = 300
    seed: int = 31
    width: int = 320
    """Pixels across the photos of the street."""
    cameras: str = "6"
    scale: float | None = 1.0
    last_frame: int | None = None
    """Last time step to use."""
    preset: Preset = "quick"
    iterations: int | None = None
    """Steps that train each piece; default: as many as fit it."""
    max_gaussians: int | None = None
    """Most Gaussians of each piece."""
    pieces: PieceChoice = "auto"
    faults: FaultModel | None = None
    """Faults that are put into the exact masks."""


def main(options: Options) -> dict[str, Any]:
    """Everything the JSON line says."""
    if options.folder is not None:
        return measure_long_drive(options, options.folder)
    with tempfile.TemporaryDirectory() as folder:
        return measure_long_drive(options, Path(folder))


def measure_long_drive(options: Options, folder: Path) -> dict[str, Any]:
    """Record, train and measure in a folder."""
    clip_path, run, masks = options.clip or folder / STREET, folder / "run", folder / "masks"
    if not (clip_path / _RECORDED).is_file() and options.clip is None:
        size = (options.width, round(options.width * 9 / 16))
        write_street(clip_path, StreetConfig(seed=options.seed, steps=options.steps, width=size[0], height=size[1]))
    part = ClipOptions(cameras=options.cameras, scale=options.scale, last_frame=options.last_frame)
    if options.clip is None and not (masks / SIDECAR).is_file():
        make_masks(load_clip(str(clip_path), part), "exact", masks, options.seed, faults=options.faults)
    request = RunRequest(
        clip_path,
        run,
        part,
        build_train_config("instdrive", options.preset, options.seed),
        masks if (masks / SIDECAR).is_file() else None,
        resume=(run / CONFIG).is_file(),
        sizes=AskedSizes(options.iterations, options.max_gaussians),
        pieces=options.pieces,
    )
    started = time.perf_counter()
    run_drive(request, lambda event: None, lambda note: print(note, file=sys.stderr, flush=True))
    trained = time.perf_counter() - started
    scene, facts, clip = read_scene_folder(run), read_run_facts(run), load_clip(str(clip_path), request.options)
    evaluation = evaluate_scene(scene, clip, find_ground_truth(clip), facts, with_reference=False)
    steps, pieces = list_steps(clip), facts.get("pieces", [])
    places = {step.index: step.place for step in steps}
    borders = [piece["core_first"] for piece in pieces[1:]]
    near = {
        index
        for index, place in places.items()
        if any(np.linalg.norm(place - places[border]) <= NEAR for border in borders)
    }
    scores = evaluation.figures["scene"]
    return {
        "clip": clip.name,
        "cameras": len(clip.camera_names),
        "photos": len(clip.training_frames),
        "metres": round(measure_drive(steps).metres, 1),
        "pieces": max(1, len(pieces)),
        "piece_metres": [piece["metres"] for piece in pieces],
        "iterations": facts["iterations"],
        "n_gaussians": len(scene),
        "n_instances": len(scene.table),
        **{name: _round(scores[name], 3) for name in ("miou", "pq", "miou_things")},
        "id_switches": scores["id_switches"],
        "id_switches_across_borders": count_border_switches(scene.instance_ids, evaluation.views, borders),
        "objects_across_borders": count_crossing_objects(evaluation.views, borders),
        "psnr": _round(evaluation.figures["psnr"], 2),
        "psnr_at_borders": _mean_psnr(evaluation, near, inside=True),
        "psnr_elsewhere": _mean_psnr(evaluation, near, inside=False),
        "peak_rss_mb": facts["peak_rss_mb"],
        "seconds": round(trained, 1),
    }


def count_border_switches(ids: np.ndarray, views: Sequence[HeldOutView], borders: Sequence[int]) -> int:
    """Count the objects on both sides of a border whose main ID is not the same there, over all borders."""
    sides = _list_sides(views, borders, ids)
    return sum(before[key] != after[key] for before, after in sides for key in before.keys() & after.keys())


def count_crossing_objects(views: Sequence[HeldOutView], borders: Sequence[int]) -> int:
    """Count the objects that are shown on both sides of a border, over all borders."""
    return sum(len(before.keys() & after.keys()) for before, after in _list_sides(views, borders, None))


def _list_sides(
    views: Sequence[HeldOutView], borders: Sequence[int], ids: np.ndarray | None
) -> list[tuple[dict[int, int], dict[int, int]]]:
    """Main ID of each object in the stretches before and after each border."""
    edges = [-1, *borders, max((view.frame.view.index for view in views), default=0) + 1]
    stretches = []
    for start, end in pairwise(edges):
        inside = [view for view in views if start <= view.frame.view.index < end]
        stretches.append(_find_main_ids(inside, ids))
    return list(pairwise(stretches))


def _find_main_ids(views: Sequence[HeldOutView], ids: np.ndarray | None) -> dict[int, int]:
    """The predicted ID of the highest IoU by object; without IDs 0 for each object that is shown."""
    if not views:
        return {}
    maps = [
        view.with_ids(np.ones(1 + max(int(v.winner.max()) for v in views), np.uint32) if ids is None else ids)
        for view in views
    ]
    counts = count_confusion(
        np.concatenate([each.truth.ravel() for each in maps]), np.concatenate([each.predicted.ravel() for each in maps])
    )
    if not len(counts.predicted_ids):
        return {}
    best = np.argmax(counts.iou, axis=1)
    return {
        int(counts.truth_ids[row]): int(counts.predicted_ids[best[row]])
        for row in np.flatnonzero(counts.iou.any(axis=1))
    }


def _mean_psnr(evaluation: Evaluation, near: set[int], inside: bool) -> float | None:
    values = [
        view.psnr for view in evaluation.views if view.psnr is not None and (view.frame.view.index in near) == inside
    ]
    return _round(float(np.mean(values)), 2) if values else None


def _round(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)


if __name__ == "__main__":
    try:
        print(json.dumps(main(tyro.cli(Options))))
    except InstDriveError as error:
        sys.exit(str(error))
