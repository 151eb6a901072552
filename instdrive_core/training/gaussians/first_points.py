"""Coloured points for the first Gaussians, gathered in one pass over sweeps and photos, time step by time step."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import cast

import numba
import numpy as np
from jaxtyping import Float32, Int64
from numpy import ndarray
from scipy import ndimage

from instdrive_core.datasets.clip import Clip
from instdrive_core.maths.streams import Stream, make_generator
from instdrive_core.scene.box_search import find_box_of_points
from instdrive_core.scene.track import Track, interpolate_tracks
from instdrive_core.training.settings.config import InitConfig
from instdrive_core.training.views.lidar_depth import find_nearest_per_pixel, find_pixels_of_points
from instdrive_core.training.views.training_view import TrainingView
from instdrive_core.training.views.view_store import ViewStore

BOX_MARGIN = 0.15
"""Metres around a moving box within which LiDAR points are taken to belong to it."""
BOX_BOTTOM = -0.1
"""Margin of the lower face for what is kept of them: cuts the road off."""
CROWD = 8
"""Before thinning, this many times as many points as will be kept are gathered at most."""
_GRID_WIDTH = 480
"""Pixels along a row between which points beyond LiDAR are chosen; more would cost time and change little."""


@dataclass(frozen=True)
class ColoredPoints:
    """Points with colours in [0, 1]."""

    positions: Float32[ndarray, "n 3"]
    colors: Float32[ndarray, "n 3"]

    def __len__(self) -> int:
        return len(self.positions)

    def take(self, rows: ndarray) -> ColoredPoints:
        """Select the points of the given rows."""
        return ColoredPoints(self.positions[rows], self.colors[rows])


def concatenate_points(parts: Sequence[ColoredPoints]) -> ColoredPoints:
    """Concatenate the parts in their order."""
    empty = np.zeros((0, 3), np.float32)
    return ColoredPoints(
        np.concatenate([empty, *(part.positions for part in parts)]),
        np.concatenate([empty, *(part.colors for part in parts)]),
    )


@dataclass(frozen=True)
class FirstPoints:
    """Points that LiDAR and photos give of the scene."""

    lidar: ColoredPoints
    """Background points of the sweeps that a camera sees, in the world."""
    near: ColoredPoints
    """On rays where LiDAR is silent, about as far as what it saw next to them."""
    far: ColoredPoints
    """On such rays, up to ten times as far."""
    actors: dict[str, ColoredPoints]
    """Points of moving objects by track, in their box frames; grey where no camera saw them."""


def gather_first_points(
    clip: Clip, views: ViewStore, config: InitConfig, seed: int, moving_actors: bool = True
) -> FirstPoints:
    """Gather the points of a clip from sweeps that may train and all views; each is read once.

    Same seed, same points, whatever the number of threads. With `moving_actors` off, points on moving objects belong
    to the background.
    """
    tracks = [track for track in clip.tracks if track.moving and moving_actors]
    sweeps = {sweep.index: sweep for sweep in clip.training_sweeps}
    numbers: dict[int, list[int]] = {step: [] for step in sweeps}
    for number, facts in enumerate(views.facts):
        numbers.setdefault(facts.step, []).append(number)
    crowd = -(-CROWD * config.lidar_points // max(1, len(sweeps)))

    def gather_step(step: int) -> FirstPoints:
        cloud = _SweepColors(sweeps[step].load().points) if step in sweeps else None
        beyond = [_gather_view(number, views, cloud, config, seed) for number in numbers[step]]
        near, far = concatenate_points([near for near, _ in beyond]), concatenate_points([far for _, far in beyond])
        if cloud is None:
            return FirstPoints(concatenate_points([]), near, far, {})
        actors, lidar = _split_actors(cloud, sweeps[step].time, tracks)
        lidar = subsample(lidar, crowd, make_generator(seed, Stream.SWEEP_SAMPLE, step))
        return FirstPoints(lidar, near, far, actors)

    with ThreadPoolExecutor(numba.get_num_threads()) as pool:
        steps = list(pool.map(gather_step, sorted(numbers)))
    return FirstPoints(
        concatenate_points([step.lidar for step in steps]),
        concatenate_points([step.near for step in steps]),
        concatenate_points([step.far for step in steps]),
        {
            track.id: concatenate_points([step.actors[track.id] for step in steps if track.id in step.actors])
            for track in tracks
        },
    )


def _gather_view(
    number: int, views: ViewStore, cloud: _SweepColors | None, config: InitConfig, seed: int
) -> tuple[ColoredPoints, ColoredPoints]:
    """Colour the sweep's points by a view, and return the near and far points beyond LiDAR."""
    view = views.get(number)
    if cloud is not None:
        cloud.add(view)
    return sample_beyond_lidar(view, config, len(views), make_generator(seed, Stream.BEYOND_LIDAR, number))


def subsample(points: ColoredPoints, limit: int, rng: np.random.Generator) -> ColoredPoints:
    """Choose at most `limit` of the points at random; they keep their order."""
    if len(points) <= limit:
        return points
    return points.take(np.sort(rng.choice(len(points), limit, replace=False)))


class _SweepColors:
    """A sweep's points with the pixels that they fall on; of several photos the last one counts."""

    def __init__(self, points: Float32[ndarray, "n 3"]) -> None:
        self.points = points
        self.colors = np.full((len(points), 3), 0.5, np.float32)
        self.seen = np.zeros(len(points), bool)

    def add(self, view: TrainingView) -> None:
        pixels, _ = find_pixels_of_points(self.points, view.camera)
        rows = np.flatnonzero(pixels >= 0)
        if view.valid is not None:
            rows = rows[view.valid.ravel()[pixels[rows]]]
        self.colors[rows] = view.image.reshape(-1, 3)[pixels[rows]] / np.float32(255)
        self.seen[rows] = True

    def take(self, rows: ndarray) -> ColoredPoints:
        return ColoredPoints(self.points[rows], self.colors[rows])


def _split_actors(
    cloud: _SweepColors, time: float, tracks: list[Track]
) -> tuple[dict[str, ColoredPoints], ColoredPoints]:
    """Split a sweep into points on each moving object, in its box frame, and background points that a camera sees."""
    tracks = [track for track in tracks if track.covers(time)]
    poses = interpolate_tracks(tracks, time)
    dimensions = np.array([track.dimensions for track in tracks]).reshape(-1, 3)
    background = cloud.seen & (find_box_of_points(cloud.points, poses, dimensions, BOX_MARGIN) < 0)
    holder = find_box_of_points(cloud.points, poses, dimensions, BOX_MARGIN, BOX_BOTTOM)
    actors = {}
    for number in np.unique(holder[holder >= 0]):
        points, pose = cloud.take(np.flatnonzero(holder == number)), poses[number]
        local = (points.positions - pose[:3, 3]) @ pose[:3, :3]
        actors[tracks[number].id] = ColoredPoints(local.astype(np.float32), points.colors)
    return actors, cloud.take(np.flatnonzero(background))


def sample_beyond_lidar(
    view: TrainingView, config: InitConfig, view_count: int, rng: np.random.Generator
) -> tuple[ColoredPoints, ColoredPoints]:
    """Sample points on rays of pixels where LiDAR is silent and no sky is known: near ones and far ones.

    Near ones take the depth of the nearest LiDAR pixel of that image (facades go on upwards), with 10 % spread;
    far ones are uniform in inverse depth between that depth and ten times as far.
    """
    pixels, depths = _silent_pixels(view)

    def on_rays(spread: ndarray) -> ColoredPoints:
        chosen = rng.choice(len(pixels), len(spread), replace=False)
        return place_on_rays(view, pixels[chosen], depths[chosen] * spread)

    near, far = (min(len(pixels), -(-count // view_count)) for count in (config.near_points, config.far_points))
    return (
        on_rays(np.exp(rng.normal(0, 0.1, near))),
        on_rays(1 / rng.uniform(0.1, 1.0, far)),
    )


def _silent_pixels(view: TrainingView) -> tuple[Int64[ndarray, " k"], Float32[ndarray, " k"]]:
    """Flat indices of pixels far from any LiDAR depth, valid and not sky, and the depths nearest to them in the image.

    Looks at every pixel of small photos, at one of each block of larger ones.
    """
    width = view.camera.width
    block = max(1, round(width / _GRID_WIDTH))
    depth = _block_depths(view, block)
    if not depth.any():
        return np.zeros(0, np.int64), np.zeros(0, np.float32)
    found = ndimage.distance_transform_edt(depth == 0, return_indices=True)
    distance, (rows, columns) = cast(tuple[ndarray, ndarray], found)
    silent = distance * block > max(4, 0.02 * width)
    middle = (slice(block // 2, None, block),) * 2
    grid_height, grid_width = depth.shape
    for mask in (view.valid, None if view.sky is None else ~view.sky):
        if mask is not None:
            silent &= mask[middle][:grid_height, :grid_width]
    chosen = np.flatnonzero(silent)
    v, u = np.divmod(chosen, grid_width)
    nearest = depth[rows.ravel()[chosen], columns.ravel()[chosen]]
    return (v * block + block // 2) * width + u * block + block // 2, nearest


def _block_depths(view: TrainingView, block: int) -> Float32[ndarray, "h w"]:
    """The smallest LiDAR depth of each whole block of pixels, 0 = unknown."""
    height, width = view.camera.height // block, view.camera.width // block
    rows, columns = (index // block for index in np.divmod(view.depth_pixels, view.camera.width))
    whole = (rows < height) & (columns < width)
    pixels, depths = find_nearest_per_pixel(rows[whole] * width + columns[whole], view.depth_values[whole])
    depth = np.zeros((height, width), np.float32)
    depth.ravel()[pixels] = depths
    return depth


def place_on_rays(view: TrainingView, pixels: Int64[ndarray, " k"], z: ndarray) -> ColoredPoints:
    """Place points at depths `z` (metres along the optical axis) behind pixels, in their colours."""
    camera = view.camera
    v, u = np.divmod(pixels, camera.width)
    local = np.stack([(u + 0.5 - camera.cx) / camera.fx * z, (v + 0.5 - camera.cy) / camera.fy * z, z], axis=1)
    world = local @ camera.world_from_camera[:3, :3].T + camera.position
    return ColoredPoints(world.astype(np.float32), view.image.reshape(-1, 3)[pixels] / np.float32(255))
