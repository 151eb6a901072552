"""The first Gaussians: LiDAR coloured by projection, moving objects in their own frames, and what LiDAR cannot see."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
from jaxtyping import Float32, UInt16
from numpy import ndarray
from scipy import ndimage
from scipy.spatial import KDTree

from instdrive_core.datasets.clip import Clip
from instdrive_core.errors import DataError
from instdrive_core.maths.activations import logit
from instdrive_core.maths.spherical_harmonics import REST_COUNTS, dc_from_color
from instdrive_core.scene.gaussians import Gaussians, concatenated
from instdrive_core.scene.track import Track, points_inside
from instdrive_core.training.config import InitConfig
from instdrive_core.training.views import TrainingView

_BOX_MARGIN = 0.15
"""Metres around a moving box within which LiDAR points are taken to belong to it."""
_MIN_ACTOR_POINTS = 30
"""A moving object hit less often stays out: nothing could be learned of its shape."""


@dataclass(frozen=True)
class ColoredPoints:
    """Points with colours in [0, 1]."""

    positions: Float32[ndarray, "n 3"]
    colors: Float32[ndarray, "n 3"]

    def take(self, rows: ndarray) -> ColoredPoints:
        """Some of the points."""
        return ColoredPoints(self.positions[rows], self.colors[rows])


def joined(parts: list[ColoredPoints]) -> ColoredPoints:
    """All points in order."""
    empty = np.zeros((0, 3), np.float32)
    return ColoredPoints(
        np.concatenate([empty, *(part.positions for part in parts)]),
        np.concatenate([empty, *(part.colors for part in parts)]),
    )


@dataclass(frozen=True)
class InitialScene:
    """Gaussians ordered background first, then actor by actor."""

    gaussians: Gaussians
    nodes: UInt16[ndarray, " n"]
    actors: tuple[Track, ...]


def initial_scene(clip: Clip, views: list[TrainingView], config: InitConfig, sh_degree: int, seed: int) -> InitialScene:
    """Place and colour the first Gaussians. Features have no columns yet.

    Raises DataError where the clip's training time steps hold no LiDAR point that a camera sees.
    """
    rng = np.random.default_rng((seed, 0))
    background, actor_points = _points_of_sweeps(clip, views)
    if not len(background.positions):
        raise DataError(clip.path, "no LiDAR point of the training time steps is seen by a camera", "Check lidar/.")
    centers = np.stack([view.camera.position for view in views]).astype(np.float32)
    background = _thinned(background, centers, config.lidar_points, rng)
    extra = joined(
        [
            _points_beyond_lidar(views, config.near_points, rng, far=False),
            _points_beyond_lidar(views, config.far_points, rng, far=True),
        ]
    )
    background = joined([background, extra])
    parts = [_gaussians_from_points(background, centers, config.opacity, sh_degree)]
    nodes, actors = [np.zeros(len(background.positions), np.uint16)], []
    for track in clip.tracks:
        points = joined(actor_points.get(track.id, []))
        if len(points.positions) < _MIN_ACTOR_POINTS:
            continue
        if len(points.positions) > config.actor_points:
            points = points.take(np.sort(rng.choice(len(points.positions), config.actor_points, replace=False)))
        actors.append(track)
        parts.append(_gaussians_from_points(points, None, config.opacity, sh_degree))
        nodes.append(np.full(len(points.positions), len(actors), np.uint16))
    return InitialScene(concatenated(parts), np.concatenate(nodes), tuple(actors))


def _points_of_sweeps(clip: Clip, views: list[TrainingView]) -> tuple[ColoredPoints, dict[str, list[ColoredPoints]]]:
    """Coloured LiDAR points: of the background in the world, of each moving object in its box frame."""
    by_index: dict[int, list[TrainingView]] = {}
    for view in views:
        by_index.setdefault(int(view.key.rsplit("/", 1)[1]), []).append(view)
    background: list[ColoredPoints] = []
    actors: dict[str, list[ColoredPoints]] = {}
    moving = [track for track in clip.tracks if track.moving]
    for sweep in clip.training_sweeps():
        points = sweep.load().points
        colored, seen = _colors_by_projection(points, by_index.get(sweep.index, []))
        free = np.ones(len(points), bool)
        for track in moving:
            if not track.covers(sweep.time):
                continue
            pose = track.pose_at(sweep.time)
            inside = points_inside(points, pose, track.dimensions, _BOX_MARGIN, bottom=-0.1)
            free &= ~points_inside(points, pose, track.dimensions, _BOX_MARGIN)
            if inside.any():
                local = (points[inside] - pose[:3, 3]) @ pose[:3, :3]
                colors = np.where(seen[inside, None], colored[inside], 0.5)
                actors.setdefault(track.id, []).append(
                    ColoredPoints(local.astype(np.float32), colors.astype(np.float32))
                )
        keep = free & seen
        background.append(ColoredPoints(points[keep], colored[keep]))
    return joined(background), actors


def _colors_by_projection(
    points: Float32[ndarray, "n 3"], views: list[TrainingView]
) -> tuple[Float32[ndarray, "n 3"], ndarray]:
    """The pixel that each point falls on (last camera that sees it), and whether any camera does."""
    colors, seen = np.zeros((len(points), 3), np.float32), np.zeros(len(points), bool)
    for view in views:
        pixels, depths = view.camera.project(points)
        columns, rows = np.floor(pixels[:, 0]), np.floor(pixels[:, 1])
        inside = (depths > 0.5) & (columns >= 0) & (rows >= 0)
        inside &= (columns < view.camera.width) & (rows < view.camera.height)
        index = np.flatnonzero(inside)
        r, c = rows[index].astype(np.int64), columns[index].astype(np.int64)
        if view.valid is not None:
            index, r, c = (array[view.valid[r, c]] for array in (index, r, c))
        colors[index] = view.image[r, c] / np.float32(255)
        seen[index] = True
    return colors, seen


def _thinned(
    points: ColoredPoints, centers: Float32[ndarray, "c 3"], limit: int, rng: np.random.Generator
) -> ColoredPoints:
    """At most `limit` points, one per voxel; voxels double in size with each doubling of the distance to the path."""
    if len(points.positions) > 8 * limit:
        points = points.take(np.sort(rng.choice(len(points.positions), 8 * limit, replace=False)))
    if len(points.positions) <= limit:
        return points
    distances, _ = KDTree(centers).query(points.positions, workers=-1)
    level = np.floor(np.log2(np.maximum(distances, 4.0) / 4.0) * 2) / 2
    order = rng.permutation(len(points.positions))
    low, high = 0.005, 2.0
    kept = order[:limit]
    for _ in range(12):
        size = np.sqrt(low * high)
        cells = np.floor(points.positions[order] / (size * 2 ** level[order, None])).astype(np.int64)
        keys = cells @ np.array([73856093, 19349663, 83492791]) + (level[order] * 2).astype(np.int64) * 2654435761
        first = np.unique(keys, return_index=True)[1]
        if len(first) > limit:
            low = size
        else:
            high, kept = size, order[first]
            if len(first) > 0.97 * limit:
                break
    return points.take(np.sort(kept))


def _points_beyond_lidar(views: list[TrainingView], count: int, rng: np.random.Generator, far: bool) -> ColoredPoints:
    """Points on rays of pixels where LiDAR is silent and no sky is known.

    Near ones take the depth of the nearest LiDAR pixel of that image (facades go on upwards), with 10 % spread;
    far ones are uniform in inverse depth between that depth and ten times as far.
    """
    parts = []
    per_view = -(-count // len(views))
    for view in views:
        depth = view.depth_map()
        if not depth.any():
            continue
        found = ndimage.distance_transform_edt(depth == 0, return_indices=True)
        distance, (rows, columns) = cast(tuple[ndarray, ndarray], found)
        silent = distance > max(4, 0.02 * view.camera.width)
        for mask in (view.valid, None if view.sky is None else ~view.sky):
            if mask is not None:
                silent &= mask
        candidates = np.flatnonzero(silent)
        if not len(candidates):
            continue
        chosen = rng.choice(candidates, min(per_view, len(candidates)), replace=False)
        nearest = depth[rows.ravel()[chosen], columns.ravel()[chosen]].astype(np.float64)
        if far:
            z = 1 / rng.uniform(0.1, 1.0, len(chosen)) * nearest
        else:
            z = nearest * np.exp(rng.normal(0, 0.1, len(chosen)))
        v, u = np.divmod(chosen, view.camera.width)
        local = np.stack(
            [(u + 0.5 - view.camera.cx) / view.camera.fx * z, (v + 0.5 - view.camera.cy) / view.camera.fy * z, z], 1
        )
        world = local @ view.camera.world_from_camera[:3, :3].T + view.camera.position
        colors = view.image.reshape(-1, 3)[chosen] / np.float32(255)
        parts.append(ColoredPoints(world.astype(np.float32), colors))
    return joined(parts)


def _gaussians_from_points(
    points: ColoredPoints, centers: Float32[ndarray, "c 3"] | None, opacity: float, sh_degree: int
) -> Gaussians:
    """Isotropic Gaussians as wide as the mean distance to 3 neighbours, at most 3 % of the distance to the cameras."""
    count = len(points.positions)
    neighbours = min(4, count)
    distances, _ = KDTree(points.positions).query(points.positions, k=neighbours, workers=-1)
    spacing = distances.reshape(count, -1)[:, 1:].mean(axis=1) if neighbours > 1 else np.full(count, 0.1)
    limit = 0.3
    if centers is not None:
        limit = np.maximum(0.3, 0.03 * KDTree(centers).query(points.positions, workers=-1)[0])
    scales = np.clip(spacing, 0.005, limit)
    quats = np.zeros((count, 4), np.float32)
    quats[:, 0] = 1
    return Gaussians(
        means=points.positions,
        quats=quats,
        log_scales=np.repeat(np.log(scales)[:, None], 3, axis=1).astype(np.float32),
        opacity_logits=np.full(count, logit(np.array([opacity]))[0], np.float32),
        sh_dc=dc_from_color(points.colors).astype(np.float32),
        sh_rest=np.zeros((count, REST_COUNTS[sh_degree], 3), np.float32),
        features=np.zeros((count, 0), np.float32),
    )
