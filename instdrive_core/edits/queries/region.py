"""Finding what lies in a region of the picture: splats by their centres, instances by most of their splats."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Int64, UInt32
from numpy import ndarray

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.shown_means import compute_shown_means
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.screen_region import find_points_in_region

NEAR = 0.1
"""Metres before the camera from which on splats are drawn."""
MIN_SHARE = 0.5
"""An instance is in a region where more than this share of it is."""


def find_rows_in_region(
    document: Document,
    camera: Camera,
    time: float,
    region: Bool[ndarray, "h w"],
    winners: UInt32[ndarray, "h w"] | None = None,
) -> Int64[ndarray, " m"]:
    """Rows of the drawn splats whose projected centre lies in the region.

    Args:
        document: what is shown.
        camera: its size is the region's.
        time: seconds.
        region: see `scene.screen_region.rasterize_polygon`.
        winners: row + 1 of the splat that each pixel stands for, 0 = none; where given, only splats that any pixel
            stands for are found: those that are visible.
    """
    means, drawn = compute_shown_means(document, time, camera.lag)
    if winners is not None:
        drawn &= _find_winning(winners, len(means))
    return np.flatnonzero(find_points_in_region(means, camera, region, NEAR) & drawn)


def find_instances_in_region(
    document: Document,
    camera: Camera,
    time: float,
    region: Bool[ndarray, "h w"],
    winners: UInt32[ndarray, "h w"] | None = None,
    min_share: float = MIN_SHARE,
) -> tuple[int, ...]:
    """IDs of the instances of which more than `min_share` lies in the region, rising.

    With `winners` it is the share of the pixels that show the instance: what hides behind others does not count.
    Without, it is the share of the instance's drawn splats, seen or not, by their centres. Arguments as for
    `find_rows_in_region`.
    """
    ids = document.scene.instance_ids
    if winners is not None:
        shown = np.append(np.uint32(0), ids)[winners]
        return find_ids_with_share(shown[region], shown.ravel(), min_share)
    means, drawn = compute_shown_means(document, time, camera.lag)
    inside = find_points_in_region(means, camera, region, NEAR) & drawn
    return find_ids_with_share(ids[inside], ids[drawn], min_share)


def find_ids_with_share(
    inside: UInt32[ndarray, " a"], everywhere: UInt32[ndarray, " b"], min_share: float = MIN_SHARE
) -> tuple[int, ...]:
    """IDs of which more than `min_share` of `everywhere` is `inside`, rising; both list an ID per splat, 0 = none."""
    found, counts = np.unique(inside, return_counts=True)
    # IDs may be large and sparse: places in the short list of those found are counted, not the IDs.
    places = np.searchsorted(found, everywhere).clip(max=max(len(found) - 1, 0))
    if not len(found):
        return ()
    totals = np.bincount(places[found[places] == everywhere], minlength=len(found))
    return tuple(found[(counts > min_share * totals) & (found > 0)].tolist())


def _find_winning(winners: UInt32[ndarray, "h w"], count: int) -> Bool[ndarray, " n"]:
    wins = np.zeros(count + 1, np.bool_)
    wins[winners.ravel()] = True
    return wins[1:]
