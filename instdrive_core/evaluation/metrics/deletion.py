"""What remains and what else changes after a click's selection is deleted."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64
from numpy import ndarray

from instdrive_core.datasets.clip import Frame
from instdrive_core.evaluation.metrics.clicks import Clicks
from instdrive_core.evaluation.metrics.held_out import HeldOutView
from instdrive_core.evaluation.metrics.world_gaussians import WorldGaussians, place_world_gaussians
from instdrive_core.maths.streams import Stream, make_generator
from instdrive_core.rasterize.kernels.sky_behind import render_sky_behind
from instdrive_core.rasterize.kernels.view_colors import compute_colors
from instdrive_core.rasterize.partial_redraw import redraw_without_rows
from instdrive_core.rasterize.render import Raster, render, render_backward
from instdrive_core.scene.camera import PhotoLag
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.track import Track, find_points_inside

MAX_DELETIONS = 150
"""More selections than this, counted once per view, are sampled."""
VISIBLE_CHANGE = 8 / 255
"""A pixel has changed when any of its channels differs by more."""
ROAD_CUT = 0.2
"""Metres cut off a box from below, so that the road in it is no residue."""


@dataclass(frozen=True)
class _Effect:
    """Effect of one deletion on one object that was meant."""

    clicks: int
    collateral: float | None
    residue: float | None
    residue_kept: float | None


def score_deletions(
    scene: Scene,
    views: Sequence[HeldOutView],
    clicks: Sequence[Clicks],
    boxes: Mapping[int, Track],
    seed: int,
    progress: Callable[[str, int, int], None],
) -> dict[str, float | None]:
    """Delete what each click selected and look at the same view again; means over the clicks that hit.

    A user sees what is selected before deleting it: misses are counted by the hit rate, not once more here.

    `collateral`: share of the pixels outside the object's ground-truth mask (ego vehicle left out) that change
    visibly. `residue`: blending weight, summed over the image, of the Gaussians inside the object's box after the
    deletion ÷ before. It counts what the deletion uncovers, too: background whose centre lies in a moving object's box
    comes to light. `residue_kept` does not: share of the weight before that belongs to Gaussians which stay. Objects
    without a box, and boxes that show nothing, have neither. `boxes` maps ground-truth IDs to tracks.
    """
    hits = [each for each in clicks if each.hit]
    selections = sorted({(each.view, each.selected) for each in hits})
    if len(selections) > MAX_DELETIONS:
        kept = make_generator(seed, Stream.DELETIONS).choice(len(selections), MAX_DELETIONS, replace=False)
        selections = [selections[index] for index in np.sort(kept)]
    shown_in = sorted({number for number, _ in selections})
    effects: list[_Effect] = []
    for number, group in groupby(selections, key=lambda selection: selection[0]):
        in_view = [each for each in hits if each.view == number]
        effects += _measure_effects(scene, views[number], [selected for _, selected in group], in_view, boxes)
        progress("deletions", shown_in.index(number) + 1, len(shown_in))
    clicked = [effect.clicks for effect in effects]
    return {
        "collateral": _mean([effect.collateral for effect in effects], clicked),
        "residue": _mean([effect.residue for effect in effects], clicked),
        "residue_kept": _mean([effect.residue_kept for effect in effects], clicked),
    }


def _measure_effects(
    scene: Scene,
    view: HeldOutView,
    selections: Sequence[int],
    clicks: Sequence[Clicks],
    boxes: Mapping[int, Track],
) -> list[_Effect]:
    """Measure what deleting each selection does to one view."""
    meant = sorted({each.truth_id for each in clicks})
    drawing = _Drawing(scene, view.frame, [boxes.get(truth_id) for truth_id in meant])
    valid = np.ones(view.truth.shape, bool) if view.frame.valid is None else view.frame.valid
    effects = []
    for selected in selections:
        after = drawing.delete(scene.instance_ids == selected)
        for each in clicks:
            if each.selected != selected:
                continue
            column = meant.index(each.truth_id)
            outside = (view.truth != each.truth_id) & valid
            harmed = np.count_nonzero(after.changed & outside[after.window])
            collateral = harmed / np.count_nonzero(outside) if outside.any() else None
            before, kept = drawing.weights[column], after.kept[column]
            residues = (after.weights[column] / before, kept / before) if before > 0 else (None, None)
            effects.append(_Effect(each.count, collateral, *residues))
    return effects


@dataclass(frozen=True)
class _Deleted:
    """A view after a deletion, where it may look different."""

    window: tuple[slice, slice]
    changed: Bool[ndarray, "wh ww"]
    """Pixels that changed visibly."""
    weights: Float64[ndarray, " boxes"]
    """Weights after the deletion, in the order of `_Drawing.weights`."""
    kept: Float64[ndarray, " boxes"]
    """The part of `_Drawing.weights` that belongs to Gaussians which are not deleted."""


class _Drawing:
    """One view: its colours, and how much of the image the Gaussians in each box make up."""

    def __init__(self, scene: Scene, frame: Frame, boxes: Sequence[Track | None]) -> None:
        camera, time = frame.view.camera, frame.view.time
        world, (poses, _) = place_world_gaussians(scene, time, camera.lag), scene.find_node_poses(time, camera.lag)
        gaussians = scene.gaussians
        colors = compute_colors(world.means, gaussians.sh_dc, gaussians.sh_rest, camera.position, scene.nodes, poses)
        channels = np.zeros((len(colors), 3 + len(boxes)), np.float32)
        channels[:, :3] = colors
        self.inside = [_find_rows_inside(world, box, time, camera.lag) for box in boxes]
        for column, rows in enumerate(self.inside):
            channels[rows, 3 + column] = 1
        self.raster = render(world.means, world.quats, world.log_scales, world.opacities, channels, camera)
        self.sky = render_sky_behind(scene.sky, camera, np.zeros_like(self.raster.alpha))
        self.colors = self._colors(self.raster.image, self.raster.alpha, (slice(None), slice(None)))
        self.weights: Float64[ndarray, " boxes"] = _sum_channels(self.raster.image)
        """Blending weight of the Gaussians inside each box, summed over the pixels; 0 without a box."""
        self.row_weights = _sum_row_weights(self.raster)

    def delete(self, deleted: Bool[ndarray, " n"]) -> _Deleted:
        """Draw the view without some rows of the scene."""
        after = redraw_without_rows(self.raster, deleted)
        colors = self._colors(after.image, after.alpha, after.window)
        changed = np.abs(colors - self.colors[after.window]).max(axis=2, initial=0) > VISIBLE_CHANGE
        lost = _sum_channels(self.raster.image[after.window]) - _sum_channels(after.image)
        kept = [self.row_weights[rows[~deleted[rows]]].sum() for rows in self.inside]
        return _Deleted(after.window, changed, self.weights - lost, np.array(kept, np.float64))

    def _colors(self, image: ndarray, alpha: ndarray, window: tuple[slice, slice]) -> Float32[ndarray, "wh ww 3"]:
        """Colours that are seen, in [0, 1]."""
        return np.clip(image[..., :3] + (1 - alpha[..., None]) * self.sky[window], 0, 1)


def _sum_row_weights(raster: Raster) -> Float64[ndarray, " n"]:
    """Sum each Gaussian's blending weight over the pixels: the gradient of a summed channel with respect to it."""
    height, width, count = raster.image.shape
    of_one = np.zeros((height, width, count), np.float32)
    of_one[..., 0] = 1
    nothing = np.zeros((height, width), np.float32)
    return render_backward(raster.context, of_one, nothing, nothing, 0).channels[:, 0].astype(np.float64)


def _sum_channels(image: Float32[ndarray, "h w c"]) -> Float64[ndarray, " boxes"]:
    return image[..., 3:].sum(axis=(0, 1), dtype=np.float64)


def _find_rows_inside(
    world: WorldGaussians, box: Track | None, time: float, lag: PhotoLag | None
) -> Int64[ndarray, " k"]:
    """Find Gaussians whose centre is in a box, its bottom cut off."""
    if box is None or not box.covers(time):
        return np.zeros(0, np.int64)
    pose = box.interpolate_pose(time, lag)
    reach, middle = np.float32(np.linalg.norm(box.dimensions) / 2), pose[:3, 3].astype(np.float32)
    near = np.flatnonzero(
        (np.abs(world.means[:, :2] - middle[:2]) <= reach).all(axis=1)
    )  # boxes are small: cheap first
    return near[find_points_inside(world.means[near], pose, box.dimensions, bottom=-ROAD_CUT)]


def _mean(values: Sequence[float | None], weights: Sequence[int]) -> float | None:
    known = [(value, weight) for value, weight in zip(values, weights, strict=True) if value is not None]
    if not known:
        return None
    return float(sum(value * weight for value, weight in known) / sum(weight for _, weight in known))
