"""The evaluation protocol: a trained run in, one object of figures out. What does not apply is None, never 0."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt32, UInt64
from numpy import ndarray

from instdrive_core.datasets.clip import Clip
from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import DataError
from instdrive_core.evaluation.lidar_components import assign_component_ids
from instdrive_core.evaluation.metrics.held_out import HeldOutView, measure_held_out_view
from instdrive_core.evaluation.metrics.id_measure import (
    CLICK_KEYS,
    SEED,
    IdMeasure,
    Progress,
    build_empty_scores,
    get_codes,
    prepare_id_measure,
)
from instdrive_core.evaluation.metrics.lidar_scores import LIDAR_KEYS
from instdrive_core.evaluation.metrics.map_scores import score_scene, score_views
from instdrive_core.evaluation.metrics.object_rows import ObjectRow
from instdrive_core.evaluation.metrics.sharing import find_shared_ids
from instdrive_core.evaluation.run_facts import build_clip_options, read_run_facts
from instdrive_core.evaluation.true_ids import find_true_ids
from instdrive_core.formats.folder.scenes import read_scene_folder
from instdrive_core.masks.annotated.truth import AnnotatedTruth
from instdrive_core.masks.ground_truth import (
    NOT_KNOWN,
    GroundTruth,
    GroundTruthInstance,
    find_ground_truth,
)
from instdrive_core.maths.streams import Stream, make_generator
from instdrive_core.scene.scene import Scene
from instdrive_core.tracks.choice import default_source

MAX_REFERENCE_VIEWS = 60
"""The reference's votes come from at most this many training views, evenly spread."""

REFERENCE_KEYS = {
    "scene": ("miou", "pq", "miou_things", "miou_stuff"),
    "lidar": tuple(key for key in LIDAR_KEYS if "code" not in key),
    "click": CLICK_KEYS,
}
"""Figures that are also given of true IDs on the same Gaussians, as `reference_*`."""
FACT_KEYS = ("train_seconds", "peak_rss_mb", "iterations", "seed", "clip", "cameras", "masks", "backend")


@dataclass(frozen=True)
class Evaluation:
    """A run's figures, what trivial predictions reach on the same geometry, and what pictures and lists need."""

    figures: dict[str, Any]
    """The keys of the protocol."""
    controls: dict[str, dict[str, dict[str, Any]]]
    """Scores by name of the control: `per_view`, `scene` and `lidar`."""
    held_out_steps: tuple[int, ...]
    privileged: bool
    """The run trained on the same annotations that it is measured with."""
    scene: Scene
    views: tuple[HeldOutView, ...]
    """Measured views. A view's maps are made again without drawing: `views[k].with_ids(scene.instance_ids).predicted`
    against `views[k].truth`; its photo is `views[k].frame.load_image()`, its picture
    `view_scene(scene, frame.view.camera, frame.view.time).color`."""
    truth_instances: dict[int, GroundTruthInstance]
    """Facts of each ID of the ground truth."""
    has_truth: bool
    """Whether the clip says what is which instance; without it nothing but images is measured."""
    objects: tuple[ObjectRow, ...]
    """Every object that the held-out views show; empty where the scene has no instances."""

    @property
    def labels_free(self) -> bool:
        """Whether a run on a recorded clip took neither masks nor tracks from what people annotated."""
        figures = self.figures
        return figures["ground_truth"] == "annotations" != figures["masks"] and figures["tracks"] != "annotated"

    @property
    def shared_instances(self) -> dict[int, tuple[int, ...]]:
        """Instances that count for several objects: instance → ground-truth IDs."""
        return find_shared_ids({row.id: row.instances for row in self.objects})

    @property
    def shared_codes(self) -> dict[int, tuple[int, ...]]:
        """Codewords that count for several objects: codeword (without the + 1) → ground-truth IDs."""
        coded = {row.id: row.codes for row in self.objects if row.codes is not None}
        return {code - 1: objects for code, objects in find_shared_ids(coded).items()}


def evaluate_run(run: Path, progress: Progress = lambda stage, done, total: None) -> Evaluation:
    """Measure a finished run with the part of the clip that it was trained on.

    Raises DataError where the run, the clip or the ground truth cannot be read, or the clip has moved since.
    """
    facts = read_run_facts(run)
    scene = read_scene_folder(run)
    clip = load_clip(facts["clip"], build_clip_options(facts))
    if not np.allclose(clip.origin, scene.origin):
        problem = f"its origin {scene.origin} is not that of {clip.path}, {clip.origin}"
        raise DataError(run, problem, "Evaluate with the clip as it was when the run was trained.")
    return evaluate_scene(scene, clip, find_ground_truth(clip), facts, progress)


def evaluate_scene(
    scene: Scene,
    clip: Clip,
    ground_truth: GroundTruth,
    facts: dict[str, Any],
    progress: Progress = lambda stage, done, total: None,
    with_reference: bool = True,
) -> Evaluation:
    """Measure a scene on a clip's held-out views and sweeps; `facts` as in `read_run_facts`.

    Held-out photos are drawn with the scene's own cameras: training corrects calibrations, and never looks at them.
    Boxes and labels are the clip's own, whatever tracks and masks trained the run.

    Without `with_reference` what true IDs reach is None: they cost half of the time, and depend on the
    geometry alone.
    """
    clip = clip.with_cameras(scene.views)
    views = _measure_held_out_views(scene, clip, ground_truth, progress)
    has_truth = ground_truth.source != NOT_KNOWN
    measure = prepare_id_measure(scene, views, clip, ground_truth, progress)
    learned, objects = build_empty_scores(), ()
    if scene.instance_ids.any() and has_truth:
        learned = _measure_ids(measure, get_codes(scene), "deletions", progress)
        objects = measure.list_objects(get_codes(scene))
    reference = build_empty_scores()
    true_ids = _find_reference_ids(scene, clip, ground_truth, progress) if with_reference else None
    if true_ids is not None:
        reference = _measure_ids(measure.rename(true_ids), None, "deletions, true IDs", progress)
    bounds = {part: {f"reference_{key}": reference[part][key] for key in keys} for part, keys in REFERENCE_KEYS.items()}
    figures = {
        **_score_images(views),
        "codeword": _score_codewords(views),
        "per_view": learned["per_view"],
        **{part: learned[part] | bounds[part] for part in ("scene", "lidar", "click")},
        "ground_truth": ground_truth.source,
        "tracks": facts.get("tracks") or default_source(clip),
        "n_gaussians": len(scene),
        "n_instances": len(scene.table),
        **{key: facts[key] for key in FACT_KEYS},
    }
    controls = _build_controls(scene, clip, ground_truth) if has_truth else {}
    return Evaluation(
        figures=figures,
        controls={name: measure.rename(ids).compute_scores() for name, ids in controls.items()},
        held_out_steps=tuple(sorted({view.frame.view.index for view in views})),
        privileged=facts["masks"] == ground_truth.source == "annotations",
        scene=scene,
        views=measure.views,
        truth_instances=ground_truth.instances,
        has_truth=has_truth,
        objects=objects,
    )


def _measure_ids(
    measure: IdMeasure,
    codes: UInt64[ndarray, " n"] | None,
    stage: str,
    progress: Progress,
) -> dict[str, Any]:
    """`per_view`, `scene`, `lidar` and `click`."""
    clicked = measure.score_clicks(lambda done, total: progress(stage, done, total))
    return measure.compute_scores(codes) | {"click": clicked}


def _measure_held_out_views(
    scene: Scene, clip: Clip, ground_truth: GroundTruth, progress: Progress
) -> list[HeldOutView]:
    frames = clip.held_out_frames
    if not frames:
        problem = "the run's part of the clip has no held-out time step (frame numbers that end in 4)"
        raise DataError(clip.path, problem, "Train on a frame range that contains one.")
    views = []
    for frame in frames:
        views.append(measure_held_out_view(scene, clip, frame, ground_truth))
        progress("held-out views", len(views), len(frames))
    return views


def _score_images(views: Sequence[HeldOutView]) -> dict[str, float | None]:
    return {
        "psnr": _mean([view.psnr for view in views]),
        "ssim": _mean([view.ssim for view in views]),
        "psnr_actors": _mean([view.psnr_actors for view in views]),
    }


def _score_codewords(views: Sequence[HeldOutView]) -> dict[str, dict[str, float | None]]:
    maps = [view.with_map(view.codewords) for view in views if view.codewords is not None]
    per_view, of_scene = score_views(maps), score_scene(maps, (), ())
    return {
        "per_view": {key: per_view[key] for key in ("miou", "macc")},
        "scene": {key: of_scene[key] for key in ("miou", "macc")},
    }


def _find_reference_ids(
    scene: Scene, clip: Clip, ground_truth: GroundTruth, progress: Progress
) -> UInt32[ndarray, " n"] | None:
    """True IDs of the scene's Gaussians: from exact labels, else from annotated boxes over time and the classes and
    regions of LiDAR points, as photos show them; None where there are neither."""
    if isinstance(ground_truth, AnnotatedTruth):
        load_ids = ground_truth.draw
    elif ground_truth.source == "exact":
        load_ids = ground_truth.load
    else:
        return None
    frames = clip.training_frames
    # Not every k-th: the frames of a step follow one another by camera, and some cameras would be passed over.
    chosen = np.linspace(0, len(frames) - 1, min(len(frames), MAX_REFERENCE_VIEWS)).round().astype(int)
    return find_true_ids(
        scene, [frames[number] for number in chosen], load_ids, lambda done, total: progress("reference", done, total)
    )


def _build_controls(scene: Scene, clip: Clip, ground_truth: GroundTruth) -> dict[str, UInt32[ndarray, " n"]]:
    """IDs of the scene's Gaussians that nobody learned."""
    rows, objects = len(scene), len(ground_truth.instances)
    random_ids = make_generator(SEED, Stream.RANDOM_IDS).integers(1, objects + 1, rows).astype(np.uint32)
    controls = {"one ID for all": np.ones(rows, np.uint32), "random IDs": random_ids}
    components = assign_component_ids(scene, clip)
    return controls if components is None else controls | {"LiDAR components": components}


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None
