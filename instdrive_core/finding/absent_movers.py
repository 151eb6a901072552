"""Moving things that photos show and a scene without tracks does not: their masks must not name what is behind them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, Frame
from instdrive_core.evaluation.metrics.box_pixels import find_moving_box_pixels
from instdrive_core.finding.photo_likeness import LEAST_LIKENESS, compute_likeness
from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.track import Track
from instdrive_core.tracks.photos.seen_movers import FoundInPhotos, keep_out_movers

_FEWEST_PIXELS = 40
"""A box of fewer pixels has no detail to compare."""


def leave_out_absent_movers(scene: Scene, clip: Clip) -> tuple[Clip, int]:
    """Keep pixels out in which a clip's moving boxes show something else than the scene has there.

    A scene without tracks holds a car at one place, if at all: photos of that moment show it there, all others show
    road where it stands. Scenes with tracks stay as they are.

    Args:
        scene: in the clip's world.
        clip: its photos and tracks.

    Returns the clip, and the number of photos in which pixels are kept out. Raises DataError where one is damaged.
    """
    movers = [track for track in clip.tracks if track.moving]
    if scene.actors or not movers:
        return clip, 0
    bare = replace(scene, sky=None)
    pixels = {}
    for frame in clip.training_frames:
        absent = _find_absent(bare, frame, movers)
        if absent is not None:
            pixels[frame.key] = absent
    return keep_out_movers(clip, FoundInPhotos((), pixels)), len(pixels)


def _find_absent(scene: Scene, frame: Frame, movers: list[Track]) -> Bool[ndarray, "h w"] | None:
    """Pixels of the boxes in a photo that it does not share with the scene; None where there are none."""
    camera, time = frame.view.camera, frame.view.time
    boxes = [box for track in movers if (box := find_moving_box_pixels(camera, [track], time)).any()]
    if not boxes:
        return None
    drawn, photo = view_scene(scene, camera, time), frame.load_image()
    absent = np.zeros((camera.height, camera.width), bool)
    for box in boxes:
        if np.count_nonzero(box) < _FEWEST_PIXELS or compute_likeness(drawn, photo, box) < LEAST_LIKENESS:
            absent |= box
    return absent if absent.any() else None
