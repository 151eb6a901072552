"""Depth of training photos where no LiDAR measured it: what the photos agree on."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numba
import numpy as np
from jaxtyping import Float32
from numpy import ndarray
from PIL import Image

from instdrive_core.datasets.clip import Clip, Frame
from instdrive_core.scene.camera import Camera
from instdrive_core.stereo.photo_depths import DepthMap, estimate_depths
from instdrive_core.training.views.lidar_depth import MAX_LIDAR_DEPTH, Depths

_LEAST_KNOWN = 0.02
"""Share of the pixels below which photos do not agree; pictures of noise come to 0.7 %."""
_MOST_COMPARED = 400
"""Photos compared at most, half a second each; where there are more, those of every other time step, or fewer."""
_CORE_SECONDS = 1.0
"""What comparing a photo with its partners takes of one core."""
_NOTHING: Depths = (np.zeros(0, np.int32), np.zeros(0, np.float32))


def estimate_missing_depths(clip: Clip, on_note: Callable[[str], None]) -> list[Depths] | None:
    """Estimate the depths of a clip's training photos where it has no LiDAR to train with; None where it has.

    `on_note` is told what the user should know.

    Raises DataError where a photo is damaged.
    """
    frames = clip.training_frames
    if clip.training_sweeps or not frames:
        return None
    compared = choose_compared_frames(frames)
    on_note(f"comparing {len(compared)} photos to find how far off things are")
    maps = _estimate_maps([frames[number] for number in compared])
    found = [_NOTHING] * len(frames)
    for number, one in zip(compared, maps, strict=True):
        found[number] = _spread(one, frames[number])
    share = sum(len(depths) for _, depths in found) / sum(one.depths.size for one in maps)
    if share < _LEAST_KNOWN:
        on_note(
            "photos agree on no depths: they are too few or too far apart, or their poses do not fit. "
            "Parts of the scene may be haze"
        )
        return [_NOTHING] * len(frames)
    on_note(f"photos agree on how far off {share:.0%} of their pixels are")
    return found


def expect_comparing_seconds(clip: Clip) -> float:
    """Tell about how long comparing a clip's photos takes on this machine; 0 where LiDAR spares it."""
    photos = 0 if clip.training_sweeps else len(choose_compared_frames(clip.training_frames))
    return photos * _CORE_SECONDS / numba.get_num_threads()


def choose_compared_frames(frames: Sequence[Frame]) -> list[int]:
    """Choose the numbers of the frames that are compared: all cameras of evenly spaced time steps."""
    steps = np.array([frame.view.index for frame in frames], np.int64)
    _, ranks = np.unique(steps, return_inverse=True)
    return np.flatnonzero(ranks % -(-len(frames) // _MOST_COMPARED) == 0).tolist()


def _estimate_maps(frames: Sequence[Frame]) -> list[DepthMap]:
    def load_grey(number: int, camera: Camera) -> Float32[ndarray, "h w"]:
        grey = Image.fromarray(frames[number].load_image()).convert("L")
        return np.asarray(grey.resize((camera.width, camera.height), Image.Resampling.BOX), np.float32)

    return estimate_depths([frame.view.camera for frame in frames], load_grey)


def _spread(found: DepthMap, frame: Frame) -> Depths:
    """The depths at the photo's own pixels: those in the middle of the map's; none beyond `MAX_LIDAR_DEPTH`, nor where
    the frame is not valid."""
    rows, columns = np.nonzero((found.depths > 0) & (found.depths < MAX_LIDAR_DEPTH))
    camera, (height, width) = frame.view.camera, found.depths.shape
    full_rows = ((rows + 0.5) * camera.height / height).astype(np.int32)
    full_columns = ((columns + 0.5) * camera.width / width).astype(np.int32)
    pixels, depths = full_rows * np.int32(camera.width) + full_columns, found.depths[rows, columns]
    if frame.valid is None:
        return pixels, depths
    on_scene = frame.valid.ravel()[pixels]
    return pixels[on_scene], depths[on_scene]
