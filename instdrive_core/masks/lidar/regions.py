"""Regions of a photo around LiDAR points that already know what they belong to.

Things are drawn as whole silhouettes over the points of what is wide; superpixels and the photo's edges then settle
the borders and the pixels between points.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float32, Int32, Integer, UInt8, UInt32
from numpy import ndarray
from scipy import ndimage
from skimage.measure import label
from skimage.morphology import disk
from skimage.segmentation import slic

from instdrive_core.masks.annotated.labels import OPEN
from instdrive_core.masks.image.point_drawing import NEAR, draw_points
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
MAX_HOLE = 0.04
"""Share of the photo up to which a part of a region is a hole in another one: a window of a car that is close."""
ENCLOSED = 0.85
"""Share of a hole's rim that must be of one other label."""
RIM = 4
"""Pixels around a hole within which depths are compared."""
IN_FRONT = 0.7
"""Metres by which a part must be nearer than what surrounds it to be in front of it rather than a hole."""
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
        found = _draw_silhouette(points, camera)
        if found is None:
            continue
        crop, inside, depth = found
        seen = inside & (depth < drawn[crop]) & (depth < depths[crop] + BEHIND)
        labels[crop][seen] = number
        drawn[crop][seen] = depth[seen]
    np.minimum(depths, drawn, out=depths)


def _draw_silhouette(
    points: Float32[ndarray, "k 3"], camera: Camera
) -> tuple[tuple[slice, slice], Bool[ndarray, "a b"], Float32[ndarray, "a b"]] | None:
    """Draw a thing: the part of the image, the pixels in it, and their depths."""
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
    part = camera.crop(left, top, right, bottom)
    _, depths = draw_points(points, np.ones(len(points), np.uint32), part, POINT_SIZE)
    drawn = np.isfinite(depths)
    if not drawn.any():
        return None
    radius = int(np.clip(round(CLOSING * max(drawn.shape)), 1, MAX_CLOSING))
    closed = ndimage.binary_closing(np.pad(drawn, radius), disk(radius))[radius:-radius, radius:-radius]
    inside = np.asarray(ndimage.binary_fill_holes(closed | drawn))
    nearest = ndimage.distance_transform_edt(~drawn, return_distances=False, return_indices=True)
    return (slice(top, bottom), slice(left, right)), inside, depths[tuple(np.asarray(nearest))]


def vote_by_superpixel(
    labels: Int32[ndarray, "h w"],
    image: UInt8[ndarray, "h w 3"],
    open_to_things: Bool[ndarray, "h w"],
    things: range,
) -> Int32[ndarray, "h w"]:
    """Give `OPEN` pixels the label that prevails in their superpixel, if one does.

    Args:
        labels: seeds; `OPEN` where nothing is known.
        image: the photo.
        open_to_things: where labels in `things` may be given.
        things: range of labels that are things.
    """
    height, width = labels.shape
    count = round(height * width / SUPERPIXEL**2)
    parts = slic(image, count, COMPACTNESS, start_label=0, max_num_iter=5, channel_axis=-1)
    known = labels != OPEN
    size = int(labels.max(initial=0)) + 1
    pairs = parts[known].astype(np.int64) * size + labels[known]
    found, counts = np.unique(pairs, return_counts=True)
    part, name = found // size, found % size
    totals = np.bincount(parts[known].ravel(), minlength=int(parts.max()) + 1)
    order = np.lexsort((name, -counts, part))
    first = order[np.flatnonzero(np.diff(part[order], prepend=-1))]
    winner = np.full(int(parts.max()) + 1, OPEN, np.int32)
    prevails = counts[first] > MAJORITY * totals[part[first]]
    winner[part[first[prevails]]] = name[first[prevails]]
    voted = winner[parts]
    allowed = open_to_things | (voted < things.start) | (voted >= things.stop)
    return np.where(known | ~allowed, labels, voted).astype(np.int32)


def fill_label_holes(
    labels: Int32[ndarray, "h w"], depths: Float32[ndarray, "h w"], floors: range, things: range
) -> Int32[ndarray, "h w"]:
    """Give small parts that lie within one other label, and not in front of it, to that label: what
    LiDAR saw through a window, and pixels left open. Things and pieces of the ground are no holes in the ground.

    Args:
        labels: a number per pixel, `OPEN` where nothing is known.
        depths: metres along the optical axis, infinity where no point was drawn.
        floors: labels of the ground's pieces.
        things: labels of things.
    """
    parts = np.asarray(label(labels - OPEN, background=-1, connectivity=1)) - 1
    count = int(parts.max()) + 1
    of_part = np.zeros(count, np.int32)
    of_part[parts.ravel()] = labels.ravel()
    pairs = np.concatenate([_find_touching_parts(parts), _find_touching_parts(parts.T)])
    pairs = np.concatenate([pairs, pairs[:, ::-1]])
    total = np.bincount(pairs[:, 0], minlength=count)
    found, sides = np.unique(np.column_stack([pairs[:, 0], of_part[pairs[:, 1]]]), axis=0, return_counts=True)
    small = np.bincount(parts.ravel(), minlength=count) < MAX_HOLE * labels.size
    small[np.concatenate([parts[0], parts[-1], parts[:, 0], parts[:, -1]])] = False
    enclosed = (sides > ENCLOSED * total[found[:, 0]]) & small[found[:, 0]] & (found[:, 1] != OPEN)
    filled, boxes = labels.copy(), ndimage.find_objects(parts + 1)
    for part, outer in found[enclosed].tolist():
        if outer in floors and (of_part[part] in things or of_part[part] in floors):
            continue
        box = tuple(slice(max(0, side.start - RIM), side.stop + RIM) for side in boxes[part])
        inside = parts[box] == part
        rim = np.asarray(ndimage.binary_dilation(inside, iterations=RIM)) & (labels[box] == outer)
        if not _find_median(depths[box][inside]) < _find_median(depths[box][rim]) - IN_FRONT:
            filled[box][inside] = outer
    return filled


def _find_median(depths: Float32[ndarray, " n"]) -> float:
    """Find the median of the known depths; NaN where none is."""
    known = depths[np.isfinite(depths)]
    return float(np.median(known)) if len(known) else float("nan")


def _find_touching_parts(parts: Integer[ndarray, "h w"]) -> Integer[ndarray, "p 2"]:
    """Find pairs of different parts in pixels side by side in a row."""
    different = parts[:, 1:] != parts[:, :-1]
    return np.column_stack([parts[:, :-1][different], parts[:, 1:][different]])
