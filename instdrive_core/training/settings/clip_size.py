"""How long a run trains and how many Gaussians it may have, by the size of its clip.

Presets are made for 30 time steps of six cameras, 480 pixels wide. A longer drive needs more of both: each photo is to
be seen as often, and each metre of street has its own surfaces.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from instdrive_core.datasets.clip import Clip
from instdrive_core.training.settings.config import TrainConfig

USUAL_PHOTOS = 162
"""Training photos that presets are made for: 27 steps of six cameras."""
USUAL_WAY = 21.0
"""Metres that such a clip drives at 7 m/s."""
SEEN_AROUND = 20.0
"""Metres before and behind the drive that are seen closely."""
USUAL_PIXELS = 480 * 270
MOST_STRETCH = 4.0
"""A run is at most so many times as long as its preset: 648 photos, 120 steps of six cameras."""
MOST_GROWTH = 3.0
"""A scene has at most so many times its preset's Gaussians: 900,000 of `quick`, some 2 GB."""


@dataclass(frozen=True)
class AskedSizes:
    """What a user asks for instead of what fits the clip; None = what fits."""

    iterations: int | None = None
    """Steps of the RGB stage."""
    max_gaussians: int | None = None
    """Most Gaussians that may grow."""


def fit_to_clip(config: TrainConfig, clip: Clip, asked: AskedSizes = AskedSizes()) -> TrainConfig:
    """Stretch a configuration to a clip; clips up to the usual size keep it as it is.

    `quick` follows the clip. `demo` and `paper` keep their lengths: one promises five minutes, the other is printed.
    """
    fits = config.preset == "quick"
    stretch = compute_stretch(len(clip.training_frames)) if fits else 1.0
    growth = compute_growth(clip) if fits else 1.0
    if asked.iterations is not None:
        stretch = asked.iterations / config.geometry.iterations
    if asked.max_gaussians is not None and config.densify.max_gaussians:
        growth = asked.max_gaussians / config.densify.max_gaussians
    return _grow(_stretch(config, stretch), growth)


def compute_stretch(photos: int) -> float:
    """Compute how many times the usual iterations show each photo as often as the usual number of photos is shown."""
    return float(np.clip(photos / USUAL_PHOTOS, 1, MOST_STRETCH))


def compute_growth(clip: Clip) -> float:
    """Compute how many times the usual Gaussians a clip has room for.

    In proportion to the street that is seen closely, and to the photos' resolution along one side: finer photos show
    finer detail near the cameras, and no more of what lies far off.
    """
    way = measure_way(clip)
    if clip.points is not None:  # without LiDAR the unit may be anything
        way = 0.0
    pixels = np.mean([frame.view.camera.width * frame.view.camera.height for frame in clip.training_frames])
    length = max(1.0, (way + 2 * SEEN_AROUND) / (USUAL_WAY + 2 * SEEN_AROUND))
    return float(min(length * max(1.0, np.sqrt(pixels / USUAL_PIXELS)), MOST_GROWTH))


def measure_way(clip: Clip) -> float:
    """Measure the metres that the first camera travels from photo to photo."""
    name = clip.camera_names[0]
    places = [frame.view.camera.position for frame in clip.frames if frame.view.name == name]
    return float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum()) if len(places) > 1 else 0.0


def _stretch(config: TrainConfig, factor: float) -> TrainConfig:
    """Spread the schedule over more steps: a Gaussian is seen as often between two refinements."""
    if factor == 1:
        return config
    geometry, densify, instances = config.geometry, config.densify, config.instances

    def times(count: int) -> int:
        return max(1, round(count * factor)) if count else 0

    return replace(
        config,
        geometry=replace(
            geometry, iterations=times(geometry.iterations), coarse_iterations=times(geometry.coarse_iterations)
        ),
        densify=replace(
            densify, start=times(densify.start), every=times(densify.every), reset_every=times(densify.reset_every)
        ),
        instances=replace(instances, iterations=times(instances.iterations)),
    )


def _grow(config: TrainConfig, factor: float) -> TrainConfig:
    """Allow more Gaussians at the start and at the end; those far off stay as many."""
    if factor == 1:
        return config
    init, densify = config.init, config.densify
    return replace(
        config,
        init=replace(
            init, lidar_points=round(init.lidar_points * factor), near_points=round(init.near_points * factor)
        ),
        densify=replace(densify, max_gaussians=round(densify.max_gaussians * factor)),
    )
