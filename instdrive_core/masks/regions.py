"""Regions of a photo around LiDAR points that already know what they belong to.

Things are drawn as whole silhouettes over the points of what is wide; superpixels and the photo's edges then settle
the borders and the pixels between points.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float32, Int32, UInt8, UInt32
from numpy import ndarray
from scipy import ndimage
from skimage.morphology import disk
from skimage.segmentation import slic

from instdrive_core.masks.annotations import OPEN
from instdrive_core.masks.splatting import NEAR, splat
from instdrive_core.scene.camera import Camera

POINT_SIZE = 0.12
"""Metres that a point of a thing stands for."""
CLOSING = 0.05
"""Radius of the closing relative to the thing's size in the image."""
MAX_CLOSING = 8
BEHIND = 0.3
"""Metres by which a thing may lie behind the surface around it and still be in front."""
SUPERPIXEL = 10.0
"""Pixels along an edge of a superpixel."""
COMPACTNESS = 8.0
MAJORITY = 0.6
"""Share of a superpixel's labelled pixels that the most frequent label must have to take the others."""


def draw_things(
    things: dict[int, Float32[ndarray, "k 3"]],
    camera: Camera,
    labels: UInt32[ndarray, "h w"],
    depths: Float32[ndarray, "h w"],
) -> None:
    """Draw things as silhouettes, in place, over what is drawn already.

    Args:
        things: points in the world, by ID.
        camera: the view.
        labels: IDs.
        depths: metres along the optical axis, infinity where nothing is.
    """
    drawn = np.full(depths.shape, np.inf, np.float32)
    for number, points in things.items():
        found = _silhouette(points, camera)
        if found is None:
            continue
        crop, inside, depth = found
        seen = inside & (depth < drawn[crop]) & (depth < depths[crop] + BEHIND)
        labels[crop][seen] = number
        drawn[crop][seen] = depth[seen]
    np.minimum(depths, drawn, out=depths)


def _silhouette(
    points: Float32[ndarray, "k 3"], camera: Camera
) -> tuple[tuple[slice, slice], Bool[ndarray, "a b"], Float32[ndarray, "a b"]] | None:
    """Where a thing is drawn: a part of the image, the pixels in it, and their depths."""
    pixels, depth = camera.project(points)
    pixels = pixels[depth > NEAR]
    size = np.array([camera.width, camera.height])
    pixels = pixels[((pixels > -size / 4) & (pixels < 1.25 * size)).all(axis=1)]
    if not len(pixels):
        return None
    margin = 2 + 0.5 * POINT_SIZE * camera.fx / max(NEAR, float(depth[depth > NEAR].min()))
    left, top = np.maximum(np.floor(pixels.min(axis=0) - margin), 0).astype(int).tolist()
    right, bottom = np.minimum(np.ceil(pixels.max(axis=0) + margin), size).astype(int).tolist()
    if right <= left or bottom <= top:
        return None
    part = replace(camera, cx=camera.cx - left, cy=camera.cy - top, width=right - left, height=bottom - top)
    _, depths = splat(points, np.ones(len(points), np.uint32), part, POINT_SIZE)
    drawn = np.isfinite(depths)
    if not drawn.any():
        return None
    radius = int(np.clip(round(CLOSING * max(drawn.shape)), 1, MAX_CLOSING))
    closed = ndimage.binary_closing(np.pad(drawn, radius), disk(radius))[radius:-radius, radius:-radius]
    inside = np.asarray(ndimage.binary_fill_holes(closed | drawn))
    nearest = ndimage.distance_transform_edt(~drawn, return_distances=False, return_indices=True)
    return (slice(top, bottom), slice(left, right)), inside, depths[tuple(np.asarray(nearest))]


def superpixel_vote(
    labels: Int32[ndarray, "h w"], image: UInt8[ndarray, "h w 3"], fixed: Bool[ndarray, "h w"]
) -> Int32[ndarray, "h w"]:
    """The labels with `OPEN` pixels given the label that prevails in their superpixel, if one does.

    Args:
        labels: seeds; `OPEN` where nothing is known.
        image: the photo.
        fixed: open pixels that stay open.
    """
    height, width = labels.shape
    count = round(height * width / SUPERPIXEL**2)
    parts = slic(image, count, COMPACTNESS, start_label=0, max_num_iter=5, channel_axis=-1)
    known = labels != OPEN
    size = int(labels.max(initial=0)) + 1
    pairs = parts[known].astype(np.int64) * size + labels[known]
    found, counts = np.unique(pairs, return_counts=True)
    part, label = found // size, found % size
    totals = np.bincount(parts[known].ravel(), minlength=int(parts.max()) + 1)
    order = np.lexsort((label, -counts, part))
    first = order[np.flatnonzero(np.diff(part[order], prepend=-1))]
    winner = np.full(int(parts.max()) + 1, OPEN, np.int32)
    prevails = counts[first] > MAJORITY * totals[part[first]]
    winner[part[first[prevails]]] = label[first[prevails]]
    return np.where(known | fixed, labels, winner[parts]).astype(np.int32)
