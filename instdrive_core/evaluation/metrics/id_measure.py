"""What IDs of a scene's Gaussians are worth, whoever gave them: learned ones, true ones, trivial ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import UInt32, UInt64
from numpy import ndarray

from instdrive_core.datasets.clip import Clip
from instdrive_core.evaluation.metrics.clicks import click_things, score_selections
from instdrive_core.evaluation.metrics.deletion import score_deletions
from instdrive_core.evaluation.metrics.held_out import HeldOutView
from instdrive_core.evaluation.metrics.lidar_scores import LIDAR_KEYS, score_points
from instdrive_core.evaluation.metrics.map_scores import score_scene, score_views
from instdrive_core.evaluation.metrics.object_rows import ObjectRow, list_object_rows
from instdrive_core.evaluation.metrics.point_ids import PointSupport, compute_point_support
from instdrive_core.evaluation.metrics.point_truth import LabelledSweep, label_sweeps
from instdrive_core.evaluation.metrics.segmentation import LabelledView
from instdrive_core.masks.ground_truth import GroundTruth, GroundTruthInstance
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.track import Track

SEED = 0
"""Seed of clicks and samples, equal for every run, so that runs are compared on the same clicks."""

PER_VIEW_KEYS = ("miou", "macc", "miou_majority")
SCENE_KEYS = ("miou", "macc", "pq", "acc25", "acc50", "id_switches", "miou_things", "miou_stuff")
CLICK_KEYS = ("hit_rate", "iou", "collateral", "residue", "residue_kept")

Progress = Callable[[str, int, int], None]
"""Called with the stage's name, steps done and steps in all."""


@dataclass(frozen=True)
class IdMeasure:
    """Held-out views and points, drawn or searched once, on which the scene's instance IDs are measured."""

    scene: Scene
    views: tuple[HeldOutView, ...]
    sweeps: tuple[LabelledSweep, ...]
    supports: tuple[PointSupport, ...]
    """Support of the points of each sweep."""
    instances: dict[int, GroundTruthInstance]
    boxes: dict[int, Track]
    """Boxes by ID of the ground truth."""

    def rename(self, ids: UInt32[ndarray, " n"]) -> IdMeasure:
        """Copy the measure for other instance IDs of the scene's Gaussians."""
        named = replace(self.scene, instance_ids=ids)
        return replace(self, scene=named, views=tuple(view.rename(named) for view in self.views))

    def draw_maps(self) -> list[LabelledView]:
        """Pair the views with the maps that the IDs make."""
        return [view.with_ids(self.scene.instance_ids) for view in self.views]

    def select_truth_ids(self, kind: str) -> set[int]:
        """Select IDs of the ground truth that are ``thing`` or ``stuff``."""
        return {instance.id for instance in self.instances.values() if instance.kind == kind}

    def compute_scores(self, codes: UInt64[ndarray, " n"] | None = None) -> dict[str, Any]:
        """`per_view`, `scene` and `lidar`; `codes` as in `score_points`."""
        shown = self.draw_maps()
        return {
            "per_view": score_views(shown),
            "scene": score_scene(shown, self.select_truth_ids("thing"), self.select_truth_ids("stuff")),
            "lidar": score_points(self.sweeps, self.supports, self.scene.instance_ids, codes),
        }

    def score_clicks(self, progress: Callable[[int, int], None]) -> dict[str, Any]:
        """`click`; progress counts views."""
        clicks = click_things(self.draw_maps(), self.select_truth_ids("thing"), SEED)
        deleted = score_deletions(
            self.scene, self.views, clicks, self.boxes, SEED, lambda _, done, total: progress(done, total)
        )
        return score_selections(clicks) | deleted

    def list_objects(self, codes: UInt64[ndarray, " n"] | None = None) -> tuple[ObjectRow, ...]:
        """List a row per object.

        Codes are those of the Gaussians that pixels stand for: blended features invent codes along borders.
        """
        coded = None if codes is None else [view.with_ids(codes) for view in self.views]
        return list_object_rows(self.draw_maps(), coded, self.instances)


def prepare_id_measure(
    scene: Scene, views: list[HeldOutView], clip: Clip, ground_truth: GroundTruth, progress: Progress
) -> IdMeasure:
    """Prepare to measure. Raises DataError where a sweep is damaged."""
    sweeps = label_sweeps(clip, ground_truth)
    supports = []
    for sweep in sweeps:
        supports.append(compute_point_support(scene, sweep.points, sweep.time))
        progress("LiDAR points", len(supports), len(sweeps))
    tracks = {track.id: track for track in clip.true_tracks}
    boxes = {
        instance.id: tracks[instance.track_id]
        for instance in ground_truth.instances.values()
        if instance.track_id in tracks
    }
    return IdMeasure(scene, tuple(views), tuple(sweeps), tuple(supports), ground_truth.instances, boxes)


def build_empty_scores() -> dict[str, Any]:
    """Build the scores, with `click`, of IDs that cannot be measured: all None."""
    keys = {"per_view": PER_VIEW_KEYS, "scene": SCENE_KEYS, "lidar": LIDAR_KEYS, "click": CLICK_KEYS}
    return {part: dict.fromkeys(names) for part, names in keys.items()}


def get_codes(scene: Scene) -> UInt64[ndarray, " n"] | None:
    """Codeword + 1 of each Gaussian, since 0 is a codeword, too; None where the scene has no codewords."""
    return scene.codewords.astype(np.uint64) + np.uint64(1) if scene.code_bits else None
