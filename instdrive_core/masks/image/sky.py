"""Sky of a photo: where LiDAR looked and nothing came back, or what looks like the sky next to it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float64, Int32, UInt8
from numpy import ndarray
from scipy import ndimage

from instdrive_core.masks.image.beams import BeamField
from instdrive_core.scene.camera import Camera

MIN_DISTANCE, GAPS = 1.5, 1.4
"""Degrees, and gaps between beams, from a surface within which a pixel may be of that surface."""
LOWEST_SKY = 0.5
"""Elevation in degrees below which nothing is taken for sky."""
MAX_CONTRAST = 24.0
"""Grey levels within 3×3 pixels; what has more is something too far for the LiDAR."""
COLUMN_REACH = 0.01
"""A beam does not hit each column: surfaces count this share of the image's width to either side."""
COLOR_BINS = 24
MIN_SHARE = 0.01
"""Share of the photo from which on the sky found in it says enough about its colours."""
MIN_LIKELIHOOD = 0.97
"""Share of sky among pixels of a colour, from which on pixels of that colour next to the sky are sky."""
GAP_RIM = 0.85
"""Share of the rim of an unknown part that must be sky for the part to be sky, too."""
MIN_BLIND_LIKELIHOOD = 0.5
"""Share of sky from which on columns that seem open are sky above the highest beam."""


class SkyColors:
    """Smoothed histograms of the colours of known sky and of known surfaces."""

    def __init__(self) -> None:
        self._sky = np.zeros((COLOR_BINS,) * 3)
        self._surface = np.zeros((COLOR_BINS,) * 3)

    def add(self, image: UInt8[ndarray, "h w 3"], sky: Bool[ndarray, "h w"], surface: Bool[ndarray, "h w"]) -> None:
        """Learn from a photo."""
        bins = _compute_color_bins(image)
        self._sky += np.bincount(bins[sky], minlength=COLOR_BINS**3).reshape(self._sky.shape)
        self._surface += np.bincount(bins[surface], minlength=COLOR_BINS**3).reshape(self._sky.shape)

    def likelihood(self, image: UInt8[ndarray, "h w 3"]) -> Float64[ndarray, "h w"]:
        """Likelihood that each pixel's colour is the sky's, were both as frequent; 0 for colours never met."""
        sky, surface = (
            np.asarray(ndimage.gaussian_filter(counts, 0.7)) / max(1, counts.sum())
            for counts in (self._sky, self._surface)
        )
        return (sky / np.maximum(sky + surface, 1e-12)).ravel()[_compute_color_bins(image)]


def find_certain_sky(
    supported: Bool[ndarray, "h w"],
    image: UInt8[ndarray, "h w 3"],
    camera: Camera,
    beams: BeamField,
    elsewhere: SkyColors | None = None,
) -> Bool[ndarray, "h w"]:
    """Find pixels through which LiDAR beams went without meeting a surface, up to the upper edge of the photo.

    Args:
        supported: where a surface was met.
        image: the photo.
        camera: its view, in a world whose z axis points up.
        beams: where the LiDAR looks.
        elsewhere: colours of the clip's sky and surfaces. Above the highest beam, a column is open only where it looks
            more like that sky than like a surface; None = any colour may be open.
    """
    empty = _find_empty_pixels(supported, camera, beams) & (_compute_contrast(image) < MAX_CONTRAST)
    if elsewhere is not None:
        blind = _compute_elevation(camera) >= beams.highest
        empty &= ~blind | (elsewhere.likelihood(image) > MIN_BLIND_LIKELIHOOD)
    return _keep_connected(empty, _keep_top_row(empty))


def find_sky_seeds(
    supported: Bool[ndarray, "h w"],
    image: UInt8[ndarray, "h w 3"],
    camera: Camera,
    beams: BeamField,
    elsewhere: SkyColors,
) -> Bool[ndarray, "h w"]:
    """Find pixels that are sky: certainly, or by their colour and next to such.

    Between tall buildings, LiDAR reaches no sky: there, unsupported pixels at the photo's upper edge are taken for
    sky if they look like the sky `elsewhere` in the clip. Other arguments as of `find_certain_sky`.
    """
    seeds = find_certain_sky(supported, image, camera, beams, elsewhere)
    colors = SkyColors()
    colors.add(image, seeds, supported)
    is_open = ~supported & (_compute_elevation(camera) > LOWEST_SKY)
    if seeds.mean() < MIN_SHARE:
        looks_alike = is_open & (elsewhere.likelihood(image) > MIN_LIKELIHOOD)
        return seeds | _keep_connected(looks_alike, _keep_top_row(looks_alike))
    return _keep_connected(seeds | (is_open & (colors.likelihood(image) > MIN_LIKELIHOOD)), seeds)


def find_sky_gaps(unknown: Bool[ndarray, "h w"], sky: Bool[ndarray, "h w"], camera: Camera) -> Bool[ndarray, "h w"]:
    """Find unknown pixels in parts above the horizon that border on little but sky: clouds of a colour of their own."""
    parts = np.zeros(unknown.shape, np.int32)
    ndimage.label(unknown & (_compute_elevation(camera) > LOWEST_SKY), output=parts)
    count = int(parts.max())
    rims, with_sky = np.zeros(count + 1), np.zeros(count + 1)
    for one, other, beyond in _pair_neighbours(parts, sky):
        apart = (one > 0) & (one != other)
        rims += np.bincount(one[apart], minlength=count + 1)
        with_sky += np.bincount(one[apart & beyond], minlength=count + 1)
    gaps = with_sky >= GAP_RIM * np.maximum(rims, 1)
    gaps[0] = False
    return gaps[parts]


def _pair_neighbours(
    parts: Int32[ndarray, "h w"], sky: Bool[ndarray, "h w"]
) -> Iterator[tuple[ndarray, ndarray, ndarray]]:
    """Parts of pixels, parts of their neighbours on each side, and whether these are sky."""
    for here, there in ((np.s_[1:], np.s_[:-1]), (np.s_[:-1], np.s_[1:])):
        yield parts[here], parts[there], sky[there]
        yield parts[:, here], parts[:, there], sky[:, there]


def _compute_elevation(camera: Camera) -> Float64[ndarray, "h w"]:
    """Compute degrees above the horizon."""
    x = (np.arange(camera.width) + 0.5 - camera.cx) / camera.fx
    y = ((np.arange(camera.height) + 0.5 - camera.cy) / camera.fy)[:, None]
    up = camera.world_from_camera[2, :3]
    sine = (up[0] * x + up[1] * y + up[2]) / np.sqrt(x * x + y * y + 1)
    return np.degrees(np.arcsin(np.clip(sine, -1, 1)))


def _find_empty_pixels(supported: Bool[ndarray, "h w"], camera: Camera, beams: BeamField) -> Bool[ndarray, "h w"]:
    """Find pixels through which beams went without meeting a surface.

    Beams get sparser towards the upper end of the field of view; a pixel is empty if no surface lies within the
    distance of the next beams. Above the field of view, a column is taken to go on as it is at its upper end,
    or next to it: wires and poles are thin.
    """
    elevation = _compute_elevation(camera)
    reach = max(1, round(COLUMN_REACH * camera.width))
    wide = ndimage.maximum_filter1d(supported, 2 * reach + 1, axis=1)
    rows = np.arange(camera.height)[:, None]
    above = np.maximum.accumulate(np.where(wide, rows, -camera.height), axis=0)
    below = np.minimum.accumulate(np.where(wide, rows, 2 * camera.height)[::-1], axis=0)[::-1]
    distance = np.maximum(MIN_DISTANCE, GAPS * beams.compute_gaps(np.clip(elevation, 0, beams.highest)))
    free = np.minimum(rows - above, below - rows) > np.radians(distance) * camera.fy
    upper_end = np.argmin(np.abs(elevation - max(beams.upper_end, LOWEST_SKY + MIN_DISTANCE)), axis=0)
    at_end = np.take_along_axis(free, upper_end[None], axis=0)
    open_above = np.asarray(ndimage.maximum_filter1d(at_end, 4 * reach + 3, axis=1), bool)
    return free & (elevation > LOWEST_SKY) & ((elevation < beams.highest) | open_above)


def _compute_contrast(image: UInt8[ndarray, "h w 3"]) -> ndarray:
    """Compute the largest difference within 3×3 pixels in any channel."""
    values = image.astype(np.float32)
    return (ndimage.maximum_filter(values, (3, 3, 1)) - ndimage.minimum_filter(values, (3, 3, 1))).max(axis=2)


def _compute_color_bins(image: UInt8[ndarray, "h w 3"]) -> Int32[ndarray, "h w"]:
    bins = (image.astype(np.int32) * COLOR_BINS) // 256
    return (bins[..., 0] * COLOR_BINS + bins[..., 1]) * COLOR_BINS + bins[..., 2]


def _keep_top_row(mask: Bool[ndarray, "h w"]) -> Bool[ndarray, "h w"]:
    top = np.zeros_like(mask)
    top[0] = mask[0]
    return top


def _keep_connected(mask: Bool[ndarray, "h w"], start: Bool[ndarray, "h w"]) -> Bool[ndarray, "h w"]:
    """Keep the parts of `mask` that are connected with `start`."""
    return np.asarray(ndimage.binary_propagation(start & mask, mask=mask))
