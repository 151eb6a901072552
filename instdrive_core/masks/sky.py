"""Where a photo shows the sky: LiDAR looked there and nothing came back, or it looks like the sky next to it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float64, UInt8
from numpy import ndarray
from scipy import ndimage

from instdrive_core.scene.camera import Camera

HIGHEST_BEAM = 15.0
"""Elevation in degrees above which the LiDAR is blind."""
LOWEST_SKY = 0.5
"""Elevation in degrees below which nothing is taken for sky."""
MAX_CONTRAST = 24.0
"""Grey levels within 3×3 pixels; what has more is something too far for the LiDAR."""
COLUMN_REACH = 0.01
"""A beam does not hit each column: surfaces count this share of the image's width to either side."""
COLOR_BINS = 24
MIN_LIKELIHOOD = 0.97
"""Share of sky among pixels of a colour, from which on pixels of that colour next to the sky are sky."""


def sky_seeds(supported: Bool[ndarray, "h w"], image: UInt8[ndarray, "h w 3"], camera: Camera) -> Bool[ndarray, "h w"]:
    """Pixels that surely are sky.

    Args:
        supported: where a surface was met.
        image: the photo.
        camera: its view, in a world whose z axis points up.
    """
    elevation = np.degrees(np.arcsin(np.clip(camera.ray_directions()[..., 2], -1, 1)))
    empty = _empty(supported, elevation, camera) & (_contrast(image) < MAX_CONTRAST)
    seeds = _connected(empty, _top_row(empty))
    alike = ~supported & (elevation > LOWEST_SKY) & (_likelihood(image, seeds, supported) > MIN_LIKELIHOOD)
    return _connected(seeds | alike, seeds)


def _empty(supported: Bool[ndarray, "h w"], elevation: Float64[ndarray, "h w"], camera: Camera) -> Bool[ndarray, "h w"]:
    """Pixels through which beams went without meeting a surface.

    Beams get sparser towards the upper end of the field of view; a pixel is empty if no surface lies within the
    distance of the next beams. Above the field of view, a column is taken to go on as it is at its upper end,
    or next to it: wires and poles are thin.
    """
    reach = max(1, round(COLUMN_REACH * camera.width))
    wide = ndimage.maximum_filter1d(supported, 2 * reach + 1, axis=1)
    rows = np.arange(camera.height)[:, None]
    above = np.maximum.accumulate(np.where(wide, rows, -camera.height), axis=0)
    below = np.minimum.accumulate(np.where(wide, rows, 2 * camera.height)[::-1], axis=0)[::-1]
    beam_distance = 1.5 + 0.3 * np.clip(elevation, 0, HIGHEST_BEAM)
    free = np.minimum(rows - above, below - rows) > np.radians(beam_distance) * camera.fy
    upper_end = np.argmin(np.abs(elevation - (HIGHEST_BEAM - 2)), axis=0)
    at_end = np.take_along_axis(free, upper_end[None], axis=0)
    open_above = np.asarray(ndimage.maximum_filter1d(at_end, 4 * reach + 3, axis=1), bool)
    return free & (elevation > LOWEST_SKY) & ((elevation < HIGHEST_BEAM) | open_above)


def _contrast(image: UInt8[ndarray, "h w 3"]) -> ndarray:
    """Largest difference within 3×3 pixels in any channel."""
    values = image.astype(np.float32)
    return (ndimage.maximum_filter(values, (3, 3, 1)) - ndimage.minimum_filter(values, (3, 3, 1))).max(axis=2)


def _likelihood(
    image: UInt8[ndarray, "h w 3"], sky: Bool[ndarray, "h w"], surface: Bool[ndarray, "h w"]
) -> Float64[ndarray, "h w"]:
    """How likely each pixel's colour is the sky's rather than a surface's, from smoothed colour histograms."""
    bins = (image.astype(np.int32) * COLOR_BINS) // 256
    flat = (bins[..., 0] * COLOR_BINS + bins[..., 1]) * COLOR_BINS + bins[..., 2]

    def histogram(mask: Bool[ndarray, "h w"]) -> ndarray:
        counts = np.bincount(flat[mask], minlength=COLOR_BINS**3).reshape((COLOR_BINS,) * 3)
        return np.asarray(ndimage.gaussian_filter(counts.astype(np.float64), 0.7)) / max(1, int(mask.sum()))

    of_sky, of_surface = histogram(sky), histogram(surface)
    return np.asarray(of_sky / np.maximum(of_sky + of_surface, 1e-12)).ravel()[flat]


def _top_row(mask: Bool[ndarray, "h w"]) -> Bool[ndarray, "h w"]:
    top = np.zeros_like(mask)
    top[0] = mask[0]
    return top


def _connected(mask: Bool[ndarray, "h w"], start: Bool[ndarray, "h w"]) -> Bool[ndarray, "h w"]:
    """The parts of `mask` that hang together with `start`."""
    return np.asarray(ndimage.binary_propagation(start & mask, mask=mask))
