"""What LiDAR says where masks are silent: the standing things of the drive, taken as the masks of one more photo.

Segmenters leave a third of a photo in no mask, and the same regions in each photo. The weight that Gaussians have there
is given to LiDAR, so that both together have a say in everything: with masks that cover all, LiDAR has none.
"""

from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np
from jaxtyping import Bool, Float, Int64, UInt16
from numpy import ndarray
from scipy.sparse import csr_array, hstack
from scipy.spatial import KDTree

from instdrive_core.masks.lidar.scene import LidarScene
from instdrive_core.training.instances.mask_weights import MaskWeights


def assign_lidar_things(
    means: Float[ndarray, "n 3"], nodes: UInt16[ndarray, " n"], lidar: LidarScene, reach: float
) -> Int64[ndarray, " n"]:
    """Find the standing thing of the nearest LiDAR point for each Gaussian of the background.

    -1 where that point is part of the ground, a facade or a plant, whose extents LiDAR alone does not tell, or farther
    away than `reach` metres.
    """
    things = np.full(len(means), -1, np.int64)
    background = np.flatnonzero(nodes == 0)
    if not len(lidar.points) or not len(background):
        return things
    distances, nearest = KDTree(lidar.points).query(means[background], workers=numba.get_num_threads())
    ids = lidar.ids[nearest].astype(np.int64)
    things[background] = np.where((distances <= reach) & (ids >= lidar.first_thing), ids, -1)
    return things


def measure_silence(observed: MaskWeights, background: Bool[ndarray, " n"]) -> float:
    """Measure how much weight of the background lies in no mask, as a multiple of what lies in masks; at most 1."""
    if observed.unmasked is None:
        return 0.0
    silent = float(observed.unmasked[background].sum(dtype=np.float64))
    shown = float(observed.sum_shown()[background].sum(dtype=np.float64))
    return min(1.0, silent / max(shown - silent, 1e-6))


def add_lidar_masks(observed: MaskWeights, things: Int64[ndarray, " n"], share: float) -> MaskWeights:
    """Add one photo whose masks are the things: a Gaussian has `share` of its weight in all photos there.

    Args:
        observed: weights in the masks of photos, and in no mask where that was measured.
        things: of each Gaussian; -1 = in no mask of the added photo.
        share: 0 to 1.
    """
    rows = np.flatnonzero(things >= 0)
    if not len(rows) or share <= 0:
        return observed
    _, masks = np.unique(things[rows], return_inverse=True)
    count = int(masks.max()) + 1
    weights = share * observed.sum_shown()[rows]
    added = csr_array((weights.astype(np.float32), (rows, masks)), shape=(len(observed), count))
    joined = csr_array(hstack([observed.weights, added], format="csr", dtype=np.float32))
    joined.sort_indices()
    photo = int(observed.view_of_mask.max(initial=-1)) // observed.layers + 1
    numbers = np.full(count, photo * observed.layers, observed.view_of_mask.dtype)
    return replace(observed, weights=joined, view_of_mask=np.concatenate([observed.view_of_mask, numbers]))
