"""Labels spread from labelled pixels to the others along the cheapest path, where crossing an image edge is dear.

Each open pixel takes the label of the seed with the smallest geodesic distance: path length plus colour differences
along it (Criminisi et al., "GeoS: Geodesic Image Segmentation", ECCV 2008, whose raster sweeps are used here too).
"""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Bool, Float32, Int32, UInt8
from numpy import ndarray
from scipy import ndimage

NOISE = 2.0
"""Grey levels between neighbours that are no edge."""
MAX_ROUNDS = 8


def spread_labels(
    labels: Int32[ndarray, "h w"],
    image: UInt8[ndarray, "h w 3"],
    limits: Float32[ndarray, " l"],
    open_to_things: Bool[ndarray, "h w"],
    things: range,
) -> Int32[ndarray, "h w"]:
    """Fill open pixels (-1) with the labels of others.

    Args:
        labels: seeds; -1 = open.
        image: the photo; one grey level of difference between neighbours costs as much as one pixel of path.
        limits: largest distance, by label, up to which it spreads.
        open_to_things: where labels in `things` may spread.
        things: range of labels that are things.
    """
    smooth = ndimage.gaussian_filter(image.astype(np.float32), (0.7, 0.7, 0))
    filled = labels.copy()
    distances = np.where(labels >= 0, 0, np.inf).astype(np.float32)
    for _ in range(MAX_ROUNDS):
        if not _sweep(filled, distances, smooth, limits, open_to_things, things.start, things.stop):
            break
    return filled


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _sweep(
    labels: Int32[ndarray, "h w"],
    distances: Float32[ndarray, "h w"],
    image: Float32[ndarray, "h w 3"],
    limits: Float32[ndarray, " l"],
    open_to_things: Bool[ndarray, "h w"],
    first_thing: int,
    end_of_things: int,
) -> bool:
    """One pass down and one up; returns whether anything changed."""
    height, width = labels.shape
    changed = False
    for direction in (1, -1):
        for step in range(height):
            row = step if direction == 1 else height - 1 - step
            for column_step in range(width):
                column = column_step if direction == 1 else width - 1 - column_step
                if distances[row, column] == 0:
                    continue
                for neighbour in range(4):  # the half of the neighbours that this pass has met before
                    other_row = row - direction if neighbour < 3 else row
                    other_column = column + neighbour - 1 if neighbour < 3 else column - direction
                    if other_row < 0 or other_row >= height or other_column < 0 or other_column >= width:
                        continue
                    label = labels[other_row, other_column]
                    if label < 0 or (first_thing <= label < end_of_things and not open_to_things[row, column]):
                        continue
                    edge = np.float32(0)
                    for channel in range(3):
                        edge = max(edge, abs(image[row, column, channel] - image[other_row, other_column, channel]))
                    length = np.float32(1.41421356) if neighbour in (0, 2) else np.float32(1)
                    distance = distances[other_row, other_column] + length + max(np.float32(0), edge - NOISE)
                    if distance < distances[row, column] and distance <= limits[label]:
                        distances[row, column] = distance
                        labels[row, column] = label
                        changed = True
    return changed
