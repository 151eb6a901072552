"""What remains and what else changes after a click's selection is deleted."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from jaxtyping import Bool, Float32
from numpy import ndarray

from instdrive_core.datasets.clip import Frame
from instdrive_core.evaluation.clicks import Clicks
from instdrive_core.evaluation.held_out import HeldOutView
from instdrive_core.evaluation.world import WorldGaussians, world_gaussians
from instdrive_core.rasterize.render import Raster, render
from instdrive_core.rasterize.sky_behind import sky_behind
from instdrive_core.rasterize.view_colors import view_colors
from instdrive_core.rasterize.without_rows import Redrawn, without_rows
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.track import Track, points_inside

MAX_DELETIONS = 150
"""More selections than this, counted once per view, are sampled."""
VISIBLE_CHANGE = 8 / 255
"""A pixel has changed when any of its channels differs by more."""
ROAD_CUT = 0.2
"""Metres cut off a box from below, so that the road in it is no residue."""


@dataclass(frozen=True)
class _Effect:
    """Of one deletion, on one object that was meant."""

    clicks: int
    collateral: float | None
    residue: float | None


def deletion_scores(
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
    deletion ÷ before. It counts what the deletion uncovers, too. Objects without a box, and boxes that show nothing,
    have no residue. `boxes` maps ground-truth IDs to tracks.
    """
    hits = [each for each in clicks if each.hit]
    selections = sorted({(each.view, each.selected) for each in hits})
    if len(selections) > MAX_DELETIONS:
        kept = np.random.default_rng(seed).choice(len(selections), MAX_DELETIONS, replace=False)
        selections = [selections[index] for index in np.sort(kept)]
    shown_in = sorted({number for number, _ in selections})
    effects: list[_Effect] = []
    for number, group in groupby(selections, key=lambda selection: selection[0]):
        in_view = [each for each in hits if each.view == number]
        effects += _effects(scene, views[number], [selected for _, selected in group], in_view, boxes)
        progress("deletions", shown_in.index(number) + 1, len(shown_in))
    clicked = [effect.clicks for effect in effects]
    return {
        "collateral": _mean([effect.collateral for effect in effects], clicked),
        "residue": _mean([effect.residue for effect in effects], clicked),
    }


def _effects(
    scene: Scene,
    view: HeldOutView,
    selections: Sequence[int],
    clicks: Sequence[Clicks],
    boxes: Mapping[int, Track],
) -> list[_Effect]:
    """Of deleting each selection in one view."""
    meant = sorted({each.truth_id for each in clicks})
    drawing = _Drawing(scene, view.frame, [boxes.get(truth_id) for truth_id in meant])
    valid = np.ones(view.truth.shape, bool) if view.frame.valid is None else view.frame.valid
    effects = []
    for selected in selections:
        after = without_rows(drawing.raster, scene.instance_ids == selected)
        changed = np.abs(drawing.colors(after) - drawing.before).max(axis=2) > VISIBLE_CHANGE
        for each in clicks:
            if each.selected != selected:
                continue
            column = 3 + meant.index(each.truth_id)
            outside = (view.truth != each.truth_id) & valid
            collateral = float(changed[outside].mean()) if outside.any() else None
            weight, weight_before = (_weight(raster, column) for raster in (after, drawing.raster))
            effects.append(_Effect(each.count, collateral, weight / weight_before if weight_before > 0 else None))
    return effects


class _Drawing:
    """One view: its colours, then for each box how much of a pixel its Gaussians make up (0 without a box)."""

    def __init__(self, scene: Scene, frame: Frame, boxes: Sequence[Track | None]) -> None:
        self.scene, self.camera, time = scene, frame.view.camera, frame.view.time
        world, (poses, _) = world_gaussians(scene, time), scene.at(time)
        gaussians, position = scene.gaussians, self.camera.position
        colors = view_colors(world.means, gaussians.sh_dc, gaussians.sh_rest, position, scene.nodes, poses)
        inside = [_inside(world, box, time)[:, None] for box in boxes]
        channels = np.concatenate([colors, *inside], axis=1, dtype=np.float32)
        self.raster = render(world.means, world.quats, world.log_scales, world.opacities, channels, self.camera)
        self.before = self.colors(self.raster)

    def colors(self, raster: Raster | Redrawn) -> Float32[ndarray, "h w 3"]:
        """What is seen, in [0, 1]."""
        return np.clip(raster.image[..., :3] + sky_behind(self.scene.sky, self.camera, raster.alpha), 0, 1)


def _weight(raster: Raster | Redrawn, channel: int) -> float:
    return float(raster.image[..., channel].sum(dtype=np.float64))


def _inside(world: WorldGaussians, box: Track | None, time: float) -> Bool[ndarray, " n"]:
    if box is None or not box.covers(time):
        return np.zeros(len(world.means), bool)
    return points_inside(world.means, box.pose_at(time), box.dimensions, bottom=-ROAD_CUT)


def _mean(values: Sequence[float | None], weights: Sequence[int]) -> float | None:
    known = [(value, weight) for value, weight in zip(values, weights, strict=True) if value is not None]
    if not known:
        return None
    return sum(value * weight for value, weight in known) / sum(weight for _, weight in known)
