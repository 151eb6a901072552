"""The evaluation protocol: a trained run in, one object of figures out. What does not apply is None, never 0."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from instdrive_core.datasets.clip import Clip, load_clip
from instdrive_core.errors import DataError
from instdrive_core.evaluation.clicks import clicks_on_things, selection_scores
from instdrive_core.evaluation.deletion import deletion_scores
from instdrive_core.evaluation.held_out import HeldOutView, held_out_view
from instdrive_core.evaluation.map_scores import per_view_scores, scene_scores
from instdrive_core.evaluation.object_rows import ObjectRow, object_rows
from instdrive_core.evaluation.oracle import true_instance_ids
from instdrive_core.evaluation.run_facts import clip_options, read_run_facts
from instdrive_core.evaluation.segmentation import LabelledView
from instdrive_core.evaluation.sharing import shared_ids
from instdrive_core.formats.scene_folder import read_scene_folder
from instdrive_core.masks.ground_truth import GroundTruth, GroundTruthInstance, open_ground_truth
from instdrive_core.scene.scene import Scene

SEED = 0
"""Of clicks, samples and random IDs: the same for every run, so that runs are compared on the same clicks."""
MAX_ORACLE_VIEWS = 120
"""The oracle's votes come from at most this many training views, evenly spread."""

PER_VIEW_KEYS = ("miou", "macc", "miou_majority")
SCENE_KEYS = ("miou", "macc", "pq", "acc25", "acc50", "id_switches", "miou_things", "miou_stuff")
LIDAR_KEYS = ("ap", "ap50", "ap25", "miou", "vmeasure", "instances_per_object", "objects_per_instance")
FACT_KEYS = ("train_seconds", "peak_rss_mb", "iterations", "seed", "clip", "cameras", "masks", "backend")
CLICK_KEYS = ("hit_rate", "iou", "collateral", "residue")

Progress = Callable[[str, int, int], None]
"""Called with the stage's name, steps done and steps in all."""


@dataclass(frozen=True)
class Evaluation:
    """A run's figures, what trivial predictions reach on the same geometry, and what pictures and lists need."""

    figures: dict[str, Any]
    """The keys of the protocol."""
    controls: dict[str, dict[str, dict[str, Any]]]
    """By name of the control: `per_view` and `scene`."""
    held_out_steps: tuple[int, ...]
    privileged: bool
    """The run trained on the same annotations that it is measured with."""
    scene: Scene
    views: tuple[HeldOutView, ...]
    """With them, a view's maps are made again without drawing: `views[k].with_ids(scene.instance_ids).predicted`
    against `views[k].truth`; its photo is `views[k].frame.load_image()`, its picture
    `view_scene(scene, frame.view.camera, frame.view.time).color`."""
    truth_instances: dict[int, GroundTruthInstance]
    """What each ID of the ground truth is."""
    objects: tuple[ObjectRow, ...]
    """Every object that the held-out views show; empty where the scene has no instances."""

    @property
    def shared_instances(self) -> dict[int, tuple[int, ...]]:
        """Instances that count for several objects: instance → ground-truth IDs."""
        return shared_ids({row.id: row.instances for row in self.objects})

    @property
    def shared_codes(self) -> dict[int, tuple[int, ...]]:
        """Codewords that count for several objects: codeword (without the + 1) → ground-truth IDs."""
        coded = {row.id: row.codes for row in self.objects if row.codes is not None}
        return {code - 1: objects for code, objects in shared_ids(coded).items()}


def evaluate_run(run: Path, progress: Progress = lambda stage, done, total: None) -> dict[str, Any]:
    """The figures of a finished run. Raises DataError where run, clip or ground truth cannot be read."""
    return evaluation_of_run(run, progress).figures


def evaluation_of_run(run: Path, progress: Progress = lambda stage, done, total: None) -> Evaluation:
    """As `evaluate_run`, with the trivial controls."""
    facts = read_run_facts(run)
    scene = read_scene_folder(run)
    clip = load_clip(facts["clip"], clip_options(facts))
    if not np.allclose(clip.origin, scene.origin):
        problem = f"its origin {scene.origin} is not that of {clip.path}, {clip.origin}"
        raise DataError(run, problem, "Evaluate with the clip as it was when the run was trained.")
    return evaluate_scene(scene, clip, open_ground_truth(clip), facts, progress)


def evaluate_scene(
    scene: Scene,
    clip: Clip,
    ground_truth: GroundTruth,
    facts: dict[str, Any],
    progress: Progress = lambda stage, done, total: None,
) -> Evaluation:
    """Measure a scene on a clip's held-out views; `facts` as in `read_run_facts`."""
    views = _held_out_views(scene, clip, ground_truth, progress)
    instances = ground_truth.instances.values()
    things = {instance.id for instance in instances if instance.kind == "thing"}
    stuff = {instance.id for instance in instances if instance.kind == "stuff"}

    def scored(predicted: Sequence[LabelledView]) -> dict[str, dict[str, Any]]:
        return {"per_view": per_view_scores(predicted), "scene": scene_scores(predicted, things, stuff)}

    objects: tuple[ObjectRow, ...] = ()
    maps: dict[str, dict[str, Any]] = {"per_view": dict.fromkeys(PER_VIEW_KEYS), "scene": dict.fromkeys(SCENE_KEYS)}
    click: dict[str, Any] = dict.fromkeys(CLICK_KEYS)
    if scene.instance_ids.any():
        shown = [view.with_ids(scene.instance_ids) for view in views]
        maps, click = scored(shown), _click_scores(scene, clip, ground_truth, views, shown, things, progress)
        objects = object_rows(shown, _coded(scene, views), ground_truth.instances)
    oracle: dict[str, Any] = dict.fromkeys(SCENE_KEYS)
    if ground_truth.source == "exact":
        true_ids = _true_ids(scene, clip, ground_truth, progress)
        oracle = scored([view.with_ids(true_ids) for view in views])["scene"]
    figures = {
        **_image_scores(views),
        "codeword": _codeword_scores(views),
        "per_view": maps["per_view"],
        "scene": {**maps["scene"], "oracle_miou": oracle["miou"], "oracle_pq": oracle["pq"]},
        "lidar": dict.fromkeys(LIDAR_KEYS),
        "click": click,
        "n_gaussians": len(scene),
        "n_instances": len(scene.table),
        **{key: facts[key] for key in FACT_KEYS},
    }
    controls = _controls(views, len(scene), len(things | stuff))
    return Evaluation(
        figures=figures,
        controls={name: scored(predicted) for name, predicted in controls.items()},
        held_out_steps=tuple(sorted({view.frame.view.index for view in views})),
        privileged=facts["masks"] == ground_truth.source == "annotations",
        scene=scene,
        views=tuple(views),
        truth_instances=ground_truth.instances,
        objects=objects,
    )


def _held_out_views(scene: Scene, clip: Clip, ground_truth: GroundTruth, progress: Progress) -> list[HeldOutView]:
    frames = clip.held_out_frames()
    if not frames:
        problem = "the run's part of the clip has no held-out time step (frame numbers that end in 4)"
        raise DataError(clip.path, problem, "Train on a frame range that contains one.")
    views = []
    for frame in frames:
        views.append(held_out_view(scene, clip, frame, ground_truth))
        progress("held-out views", len(views), len(frames))
    return views


def _image_scores(views: Sequence[HeldOutView]) -> dict[str, float | None]:
    return {
        "psnr": _mean([view.psnr for view in views]),
        "ssim": _mean([view.ssim for view in views]),
        "psnr_actors": _mean([view.psnr_actors for view in views]),
    }


def _codeword_scores(views: Sequence[HeldOutView]) -> dict[str, dict[str, float | None]]:
    maps = [view.labelled(view.codewords) for view in views if view.codewords is not None]
    per_view, of_scene = per_view_scores(maps), scene_scores(maps, (), ())
    return {
        "per_view": {key: per_view[key] for key in ("miou", "macc")},
        "scene": {key: of_scene[key] for key in ("miou", "macc")},
    }


def _click_scores(
    scene: Scene,
    clip: Clip,
    ground_truth: GroundTruth,
    views: Sequence[HeldOutView],
    shown: Sequence[LabelledView],
    things: set[int],
    progress: Progress,
) -> dict[str, float | None]:
    tracks = {track.id: track for track in clip.tracks}
    boxes = {
        instance.id: tracks[instance.track_id]
        for instance in ground_truth.instances.values()
        if instance.track_id in tracks
    }
    clicks = clicks_on_things(shown, things, SEED)
    return selection_scores(clicks) | deletion_scores(scene, views, clicks, boxes, SEED, progress)


def _coded(scene: Scene, views: Sequence[HeldOutView]) -> list[LabelledView] | None:
    """Codeword + 1 of the Gaussian that each pixel stands for; blended features invent codes along borders."""
    if not scene.code_bits:
        return None
    return [view.with_ids(scene.codewords.astype(np.uint64) + np.uint64(1)) for view in views]


def _true_ids(scene: Scene, clip: Clip, ground_truth: GroundTruth, progress: Progress) -> np.ndarray:
    frames = clip.training_frames()
    spread = frames[:: -(-len(frames) // MAX_ORACLE_VIEWS)] if frames else frames
    return true_instance_ids(
        scene, spread, ground_truth, SEED, progress=lambda done, total: progress("oracle", done, total)
    )


def _controls(views: Sequence[HeldOutView], rows: int, objects: int) -> dict[str, list[LabelledView]]:
    random_ids = np.random.default_rng(SEED).integers(1, objects + 1, rows).astype(np.uint32)
    controls = {"one ID for all": np.ones(rows, np.uint32), "random IDs": random_ids}
    return {name: [view.with_ids(ids) for view in views] for name, ids in controls.items()}


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None
