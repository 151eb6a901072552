"""First points of clips without LiDAR: where photos agree, those that came with the cameras, and random ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from instdrive_core.datasets.clip import Clip, SparsePoints
from instdrive_core.errors import DataError
from instdrive_core.maths.streams import Stream, make_generator
from instdrive_core.training.gaussians.first_points import (
    CROWD,
    ColoredPoints,
    FirstPoints,
    concatenate_points,
    place_on_rays,
    sample_beyond_lidar,
    subsample,
)
from instdrive_core.training.settings.config import InitConfig
from instdrive_core.training.views.lidar_depth import find_pixels_of_points, project_depths
from instdrive_core.training.views.training_view import TrainingView
from instdrive_core.training.views.view_store import ViewStore

_NEAR, _FAR = (0.2, 2.0), (2.0, 20.0)
"""Depths of random points, in typical distances: nothing is known but how far the cameras lie apart."""
_LEAST_DISTANCE = 10.0
"""Metres that random points reach out at least, where the cameras hardly move."""


def gather_points_without_lidar(clip: Clip, views: ViewStore, config: InitConfig, seed: int) -> FirstPoints:
    """The points that photos agree on and the clip's own that a training photo sees; near and far ones where all are
    silent.

    Without any point, as many random ones as `config` wants LiDAR points, near ones and far ones: uniform in inverse
    depth along the photos' rays. Same seed, same points.

    Raises DataError where the clip has points and no training photo sees one.
    """
    known = concatenate_points([_find_seen_points(clip, views), _gather_agreed_points(views, config, seed)])
    reach = _typical_distance(views)
    unknown = config.near_points + (0 if len(known) else config.lidar_points)
    near, far = [], []
    for number in range(len(views)):
        view, rng = views.get(number), make_generator(seed, Stream.WITHOUT_LIDAR, number)
        if not len(view.depth_pixels):
            pixels, depths = project_depths(known.positions, view.camera)
            view = replace(view, depth_pixels=pixels, depth_values=depths)
        if len(view.depth_pixels):
            beyond = sample_beyond_lidar(view, config, len(views), rng)
        else:
            beyond = (
                _random_points(view, unknown, len(views), _NEAR, reach, rng),
                _random_points(view, config.far_points, len(views), _FAR, reach, rng),
            )
        near.append(beyond[0])
        far.append(beyond[1])
    return FirstPoints(known, concatenate_points(near), concatenate_points(far), {})


def _find_seen_points(clip: Clip, views: ViewStore) -> ColoredPoints:
    """The clip's own points that a training photo sees. Raises DataError where there are some and none is seen."""
    given = clip.points or SparsePoints.none()
    seen = np.zeros(len(given.points), bool)
    for facts in views.facts:
        seen |= find_pixels_of_points(given.points, facts.camera)[0] >= 0
    if len(seen) and not seen.any():
        problem = f"no training photo sees one of its {len(seen):,} points"
        raise DataError(clip.path, problem, "Check that poses and points belong together, or leave the points out")
    return ColoredPoints(given.points[seen], given.colors[seen] / np.float32(255))


def _gather_agreed_points(views: ViewStore, config: InitConfig, seed: int) -> ColoredPoints:
    """Points at the depths that photos agree on, as many as LiDAR would give before thinning."""
    crowd, parts = -(-CROWD * config.lidar_points // len(views)), []
    for number in range(len(views)):
        view = views.get(number)
        agreed = place_on_rays(view, view.depth_pixels.astype(np.int64), view.depth_values)
        parts.append(subsample(agreed, crowd, make_generator(seed, Stream.SWEEP_SAMPLE, number)))
    return concatenate_points(parts)


def _typical_distance(views: ViewStore) -> float:
    """Largest distance of a camera from the cameras' mean position; metres."""
    centers = np.stack([facts.camera.position for facts in views.facts])
    return max(_LEAST_DISTANCE, float(np.linalg.norm(centers - centers.mean(axis=0), axis=1).max()))


def _random_points(
    view: TrainingView,
    count: int,
    view_count: int,
    depths: tuple[float, float],
    reach: float,
    rng: np.random.Generator,
) -> ColoredPoints:
    """This view's share of `count` points behind valid pixels without sky."""
    usable = np.ones(view.image.shape[:2], bool)
    for mask in (view.valid, None if view.sky is None else ~view.sky):
        if mask is not None:
            usable &= mask
    pixels = np.flatnonzero(usable)
    if not len(pixels):
        return concatenate_points([])
    chosen = rng.choice(pixels, -(-count // view_count))
    inverse = rng.uniform(1 / depths[1], 1 / depths[0], len(chosen))
    return place_on_rays(view, chosen, reach / inverse)
