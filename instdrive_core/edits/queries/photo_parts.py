"""Photos that show most of something, no two of which are nearly the same, and the parts of them that do."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray

from instdrive_core.scene.camera import Camera, CameraView

NEAREST = 0.3
"""Metres from the camera from which on a photo shows something."""
APART = 2
"""Time steps between photos of one camera."""
BORDER = 8
"""Pixels around what a part is cut for."""


def cut_camera(camera: Camera, pixels: Float64[ndarray, "k 2"], most_pixels: int) -> Camera:
    """Cut the part of a photo around pixels; it is made smaller where it has more than `most_pixels`."""
    x0, y0 = np.maximum(np.floor(pixels.min(axis=0) - BORDER), 0).astype(int).tolist()
    x1, y1 = np.minimum(np.ceil(pixels.max(axis=0) + BORDER), [camera.width, camera.height]).astype(int).tolist()
    part = camera.crop(x0, y0, x1, y1)
    return part.scale(min(1.0, float(np.sqrt(most_pixels / (part.width * part.height)))))


def choose_apart(
    found: Iterable[tuple[float, CameraView, Camera]], most: int, taken: Sequence[CameraView] = ()
) -> list[tuple[CameraView, Camera]]:
    """Choose up to `most` photos, those that show most first, each `APART` from the others and from those taken.

    Args:
        found: how much each photo shows, the photo, and the camera of the part that does.
        taken: photos that were chosen before.
    """
    chosen: list[tuple[CameraView, Camera]] = []
    known = list(taken)
    for _, view, camera in sorted(found, key=lambda each: -each[0]):
        if len(chosen) == most:
            break
        if all(_is_apart(view, other) for other in known):
            chosen.append((view, camera))
            known.append(view)
    return chosen


def choose_covering(
    found: Sequence[tuple[float, CameraView, Camera, Bool[ndarray, " k"]]], most: int
) -> list[tuple[CameraView, Camera]]:
    """Choose up to `most` photos as `choose_apart` does, but so that together they show all parts of something.

    A part counts half as much with each photo chosen before that shows it.

    Args:
        found: how much each photo shows, the photo, the camera of the part that does, and which of k points it shows,
            at least one.
    """
    chosen: list[tuple[CameraView, Camera]] = []
    left, weights = list(found), np.ones(len(found[0][3]) if found else 0)
    while left and len(chosen) < most:
        _, view, camera, shown = max(left, key=lambda each: each[0] * weights[each[3]].mean())
        chosen.append((view, camera))
        weights[shown] /= 2
        left = [each for each in left if _is_apart(each[1], view)]
    return chosen


def _is_apart(view: CameraView, other: CameraView) -> bool:
    """Whether two photos are of different cameras, or `APART` time steps from each other."""
    return view.name != other.name or abs(view.index - other.index) >= APART
