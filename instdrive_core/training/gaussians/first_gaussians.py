"""The first Gaussians: LiDAR coloured by projection, moving objects in their own frames, and what LiDAR cannot see."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Float32, UInt16
from numpy import ndarray
from scipy.spatial import KDTree

from instdrive_core.datasets.clip import Clip
from instdrive_core.errors import DataError
from instdrive_core.maths.activations import logit
from instdrive_core.maths.spherical_harmonics import REST_COUNTS, dc_from_color
from instdrive_core.maths.streams import Stream, make_generator
from instdrive_core.scene.gaussians import Gaussians, concatenate_gaussians
from instdrive_core.scene.track import Track
from instdrive_core.training.gaussians.first_points import (
    ColoredPoints,
    concatenate_points,
    gather_first_points,
    subsample,
)
from instdrive_core.training.gaussians.first_shadows import make_first_shadow
from instdrive_core.training.gaussians.points_without_lidar import gather_points_without_lidar
from instdrive_core.training.gaussians.voxel_thinning import thin_by_voxels
from instdrive_core.training.settings.config import InitConfig
from instdrive_core.training.views.view_store import ViewStore

MIN_ACTOR_POINTS = 30
"""A moving object hit less often stays out: nothing could be learned of its shape."""
_MIN_SCENE_RADIUS = 10.0
"""Metres; keeps the means' learning rate sane where the car hardly moves."""
_RADIUS_STEPS = 30
"""Time steps whose cameras give the radius; presets are made for so many."""
_SKY_VIEWS, _SKY_STRIDE = 48, 16
"""Photos, and of them one sky pixel in so many, that the sky's mean colour is taken from."""


@dataclass(frozen=True)
class InitialScene:
    """Gaussians ordered background first, then actor by actor."""

    gaussians: Gaussians
    nodes: UInt16[ndarray, " n"]
    actors: tuple[Track, ...]


def build_initial_scene(
    clip: Clip,
    views: ViewStore,
    config: InitConfig,
    sh_degree: int,
    seed: int,
    moving_actors: bool = True,
) -> InitialScene:
    """Place and colour the first Gaussians. Features have no columns yet. Reads each sweep and photo once.

    Args:
        clip: the clip.
        views: its training photos.
        config: how many of what.
        sh_degree: degree of the spherical harmonics; all but the constant are 0.
        seed: of everything random.
        moving_actors: whether moving objects become actors of their own; else their points stay in the background.

    A clip without LiDAR starts from the points that came with its cameras, else from random ones: see
    `points_without_lidar`.

    Raises DataError where the clip has no photo or LiDAR sweep of a training time step, no camera sees a LiDAR point,
    or a photo, mask or sweep is damaged.
    """
    _check_has_data(clip, views)
    rng = make_generator(seed, Stream.LIDAR_THINNING)
    centers = np.stack([facts.camera.position for facts in views.facts]).astype(np.float32)
    if clip.training_sweeps:
        points = gather_first_points(clip, views, config, seed, moving_actors)
        if not len(points.lidar):
            problem = "no camera sees a LiDAR point of the training time steps"
            raise DataError(clip.path, problem, "Check that poses and sweeps belong together, or choose other cameras")
    else:
        points = gather_points_without_lidar(clip, views, config, seed)
    seen = points.lidar
    if len(seen):
        seen = seen.take(thin_by_voxels(seen.positions, centers, config.lidar_points, rng))
    background = concatenate_points([seen, points.near, points.far])
    parts = [_gaussians_from_points(background, centers, config.opacity, sh_degree)]
    nodes, actors = [np.zeros(len(background), np.uint16)], []
    for track in clip.tracks:
        on_track = points.actors.get(track.id)
        if on_track is None or len(on_track) < MIN_ACTOR_POINTS:
            continue
        on_track = subsample(on_track, config.actor_points, rng)
        actors.append(track)
        shadow = make_first_shadow(track, sh_degree)
        parts += [_gaussians_from_points(on_track, None, config.opacity, sh_degree), shadow]
        nodes.append(np.full(len(on_track) + len(shadow), len(actors), np.uint16))
    return InitialScene(concatenate_gaussians(parts), np.concatenate(nodes), tuple(actors))


def compute_scene_radius(views: ViewStore) -> float:
    """Compute the largest distance (metres) of a camera from the mean position of the cameras within 30 time steps, at
    least 10 m.

    Steps and sizes of Gaussians follow it, and those of a street do not grow with the way that is driven along it.
    """
    centers = np.stack([facts.camera.position for facts in views.facts])
    steps = np.array([facts.step for facts in views.facts])
    starts = np.arange(steps.min(), max(steps.min(), steps.max() - _RADIUS_STEPS + 1) + 1)
    stretches = [centers[(steps >= start) & (steps < start + _RADIUS_STEPS)] for start in starts]
    reach = [np.linalg.norm(part - part.mean(axis=0), axis=1).max() for part in stretches if len(part)]
    return max(_MIN_SCENE_RADIUS, float(max(reach)))


def compute_mean_sky_color(views: ViewStore) -> Float32[ndarray, "3"]:
    """Compute the mean colour inside the sky masks of photos spread over the clip, light
    grey without any. [0, 1]."""
    chosen = np.unique(np.linspace(0, len(views) - 1, min(len(views), _SKY_VIEWS)).astype(int)).tolist()

    def sky_pixels(number: int) -> ndarray:
        view = views.get(number)
        return np.zeros((0, 3), np.uint8) if view.sky is None else view.image[view.sky][::_SKY_STRIDE]

    with ThreadPoolExecutor(numba.get_num_threads()) as pool:
        seen = np.concatenate(list(pool.map(sky_pixels, chosen)))
    return (seen.mean(axis=0) / 255 if len(seen) else np.full(3, 0.6)).astype(np.float32)


def _check_has_data(clip: Clip, views: ViewStore) -> None:
    if not len(views):
        problem = "has no photo of a training time step (every tenth is kept for evaluation)"
        raise DataError(clip.path, problem, "Choose other cameras or a wider frame range")
    if not clip.training_sweeps and clip.points is None:
        problem = "has no LiDAR sweep of a training time step (lidar/NN.pkl.gz)"
        raise DataError(clip.path, problem, "Add sweeps, choose a wider frame range, or start from a scene with --init")


def _gaussians_from_points(
    points: ColoredPoints, centers: Float32[ndarray, "c 3"] | None, opacity: float, sh_degree: int
) -> Gaussians:
    """Make isotropic Gaussians, as wide as the mean distance to 3 neighbours, at most 3 % of that to the cameras."""
    count, threads = len(points), numba.get_num_threads()
    neighbours = min(4, count)
    distances, _ = KDTree(points.positions).query(points.positions, k=neighbours, workers=threads)
    spacing = distances.reshape(count, -1)[:, 1:].mean(axis=1) if neighbours > 1 else np.full(count, 0.1)
    limit = 0.3
    if centers is not None:
        limit = np.maximum(0.3, 0.03 * KDTree(centers).query(points.positions, workers=threads)[0])
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
