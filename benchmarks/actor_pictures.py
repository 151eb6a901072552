"""Moving objects with and without nodes of their own: `python -m benchmarks.actor_pictures STATIC_RUN RUN`.

Crops of held-out photos around the largest boxes of moving objects. Rows: photo, static-only run, run with actors.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from jaxtyping import UInt8
from numpy import ndarray
from PIL import Image
from tyro.conf import Positional

from benchmarks.pictures import clip_of_run, save_picture
from instdrive_core.datasets.clip import Clip, Frame
from instdrive_core.evaluation.metrics.box_pixels import find_box_silhouette
from instdrive_core.formats.folder.scenes import read_scene_folder
from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.scene.exposure import apply_exposure
from instdrive_core.scene.scene import Scene

_ASPECT = 1.4
"""Width of a crop over its height."""


@dataclass(frozen=True)
class Options:
    """Put photo, static run and run with actors side by side."""

    static: Positional[Path]
    run: Positional[Path]
    out: Path = Path("docs/images/moving_actors.jpg")
    count: int = 6
    """Crops, each of another object."""
    height: int = 200
    """Pixels of a crop."""


@dataclass(frozen=True)
class Crop:
    """Where one moving object is seen."""

    frame: Frame
    left: int
    top: int
    width: int
    height: int


def largest_crops(clip: Clip, count: int) -> list[Crop]:
    """The best view of each moving object, largest objects first; cut off at no border."""
    best: dict[str, tuple[int, Crop]] = {}
    for frame in clip.held_out_frames:
        camera, time = frame.view.camera, frame.view.time
        for track in clip.tracks:
            if not (track.moving and track.covers(time)):
                continue
            seen = find_box_silhouette(camera, track.interpolate_pose(time, camera.lag), track.dimensions)
            rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
            if not len(rows) or rows[0] == 0 or columns[0] == 0 or columns[-1] == camera.width - 1:
                continue
            area = int(seen.sum())
            if area > best.get(track.id, (400, None))[0]:
                best[track.id] = area, _find_surroundings(frame, rows, columns)
    ordered = sorted(best.values(), key=lambda entry: -entry[0])
    return [crop for _, crop in ordered[:count]]


def _find_surroundings(frame: Frame, rows: ndarray, columns: ndarray) -> Crop:
    camera = frame.view.camera
    height = min(int(1.5 * max(len(rows), len(columns) / _ASPECT)), camera.height)
    width = min(int(height * _ASPECT), camera.width)
    left = int(np.clip((columns[0] + columns[-1] - width) // 2, 0, camera.width - width))
    top = int(np.clip((rows[0] + rows[-1] - height) // 2, 0, camera.height - height))
    return Crop(frame, left, top, width, height)


def draw_view(scene: Scene, frame: Frame) -> UInt8[ndarray, "h w 3"]:
    """The scene as the frame's camera would have photographed it."""
    image = view_scene(scene, frame.view.camera, frame.view.time).color
    if scene.exposures is not None:
        image = apply_exposure(image, scene.exposures.interpolate(frame.view.name, frame.view.time))
    return (np.clip(image, 0, 1) * 255 + 0.5).astype(np.uint8)


def main(options: Options) -> None:
    """Write the picture."""
    clip = clip_of_run(options.run)
    scenes = [read_scene_folder(path) for path in (options.static, options.run)]
    columns = []
    for crop in largest_crops(clip, options.count):
        images = [crop.frame.load_image(), *(draw_view(scene, crop.frame) for scene in scenes)]
        size = (round(options.height * _ASPECT), options.height)
        rows = slice(crop.top, crop.top + crop.height), slice(crop.left, crop.left + crop.width)
        columns.append(np.concatenate([np.asarray(Image.fromarray(image[rows]).resize(size)) for image in images]))
    save_picture(np.concatenate(columns, axis=1), options.out)


if __name__ == "__main__":
    main(tyro.cli(Options))
