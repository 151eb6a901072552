"""What photos never show: Gaussians inside of objects and behind surfaces get the ID of what they belong to.

Without it a deleted car uncovers its own inside: road and walls seen through it, floaters that only it ever hid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Bool, Float, Float64, Int64, UInt16
from numpy import ndarray
from scipy.sparse import csc_array, csr_array
from scipy.spatial import ConvexHull, KDTree, QhullError


@dataclass(frozen=True)
class InteriorConfig:
    """Which instances are compact objects that can have an inside."""

    max_length: float = 12.0
    """Metres: larger instances are surfaces or groups of things."""
    min_height: float = 0.4
    """Metres: lower ones lie on the ground."""
    min_gaussians: int = 10
    stray_share: float = 0.01
    """Share of an instance's Gaussians, on either side of each axis, that do not count for its hull."""
    min_opacity: float = 0.1
    """Fainter Gaussians do not count for a hull."""
    ground_clearance: float = 0.1
    """Metres above the hull's lowest point that stay what they are: there lies the road."""
    growth: float = 1.1
    """Factor by which the hull is grown …"""
    margin: float = 0.1
    """… and metres on top, to find Gaussians close around it …"""
    min_share: float = 0.3
    """… which belong to the object that got at least this share of their votes."""


DEFAULT_CONFIG = InteriorConfig()


@dataclass(frozen=True)
class CompactObject:
    """The convex hull of one compact instance, standing upright."""

    instance: int
    center: Float64[ndarray, "3"]
    reach: float
    """Metres from the centre to the hull's farthest corner."""
    axes: Float64[ndarray, "3 3"]
    """Columns: the object's own axes, the third one up."""
    planes: Float64[ndarray, "k 4"]
    """Outward normals and offsets of the hull in these axes."""
    floor: float
    volume: float

    def holds(self, local: Float64[ndarray, "k 3"], growth: float = 1.0, margin: float = 0.0) -> Bool[ndarray, " k"]:
        """Whether points, seen from the centre in the object's axes, lie in the hull grown by a factor and metres."""
        planes = self.planes * [1, 1, 1, growth]
        return _find_beneath(np.ascontiguousarray(local, np.float64), planes, margin)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _find_beneath(points: ndarray, planes: ndarray, margin: float) -> ndarray:
    """Whether points lie less than `margin` outside of every plane."""
    beneath = np.ones(len(points), np.bool_)
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for k in range(len(planes)):
            if not x * planes[k, 0] + y * planes[k, 1] + z * planes[k, 2] + planes[k, 3] < margin:
                beneath[i] = False
                break
    return beneath


def fill_from_nearest(
    groups: Int64[ndarray, " n"], means: Float[ndarray, "n 3"], nodes: UInt16[ndarray, " n"]
) -> Int64[ndarray, " n"]:
    """Replace every -1 by the group of the nearest Gaussian of the same node that has one; -1 where there is none."""
    filled = groups.copy()
    for node in np.unique(nodes[groups < 0]):
        known = np.flatnonzero((nodes == node) & (groups >= 0))
        unknown = np.flatnonzero((nodes == node) & (groups < 0))
        if len(known):
            _, nearest = KDTree(means[known]).query(means[unknown], workers=numba.get_num_threads())
            filled[unknown] = groups[known[nearest]]
    return filled


def fill_compact_objects(
    groups: Int64[ndarray, " n"],
    means: Float[ndarray, "n 3"],
    opacities: Float[ndarray, " n"],
    candidates: Bool[ndarray, " n"],
    shares: csr_array,
    config: InteriorConfig = DEFAULT_CONFIG,
) -> Int64[ndarray, " n"]:
    """Give `candidates` inside the convex hull of a compact group to that group; the smallest hull wins.

    Those close around it that partly show the group join, too: an object's edge, which votes lost to what is behind.

    Args:
        groups: -1 = none.
        means: metres, z up.
        opacities: in [0, 1].
        candidates: Gaussians of the background; hulls are made of these, too.
        shares: (n, g) of each Gaussian's votes, the groups' shares.
    """
    filled, rows = groups.copy(), np.flatnonzero(candidates)
    tree, shares_of_group = KDTree(means[rows]), csc_array(shares)
    for body in sorted(_find_compact_objects(groups, means, opacities, rows, config), key=lambda body: -body.volume):
        reach = config.growth * body.reach + 2 * config.margin
        near = rows[np.sort(tree.query_ball_point(body.center, reach))]
        local = (means[near] - body.center) @ body.axes
        inside = body.holds(local) & (local[:, 2] > body.floor)
        close = body.holds(local, config.growth, config.margin)
        shown = close & _find_with_share(shares_of_group, body.instance, near, config.min_share)
        filled[near[inside | shown]] = body.instance
    return filled


def _find_with_share(shares: csc_array, group: int, rows: Int64[ndarray, " k"], minimum: float) -> Bool[ndarray, " k"]:
    entries = slice(int(shares.indptr[group]), int(shares.indptr[group + 1]))
    enough = shares.indices[entries][shares.data[entries] >= minimum]
    return np.isin(rows, enough)


def _find_compact_objects(
    groups: Int64[ndarray, " n"],
    means: Float[ndarray, "n 3"],
    opacities: Float[ndarray, " n"],
    rows: Int64[ndarray, " k"],
    config: InteriorConfig,
) -> list[CompactObject]:
    solid = rows[(groups[rows] >= 0) & (opacities[rows] >= config.min_opacity)]
    solid = solid[np.argsort(groups[solid], kind="stable")]
    numbers, starts = np.unique(groups[solid], return_index=True)
    bodies = []
    for number, members in zip(numbers.tolist(), np.split(solid, starts)[1:], strict=True):
        if len(members) >= config.min_gaussians:
            body = fit_compact_object(number, means[members].astype(np.float64), config)
            bodies += [] if body is None else [body]
    return bodies


def fit_compact_object(
    instance: int, points: Float64[ndarray, "k 3"], config: InteriorConfig = DEFAULT_CONFIG
) -> CompactObject | None:
    """Fit the compact object that points (metres, z up) span; None where they are too large, too flat or too few."""
    center, axes = np.median(points, axis=0), np.eye(3)
    axes[:2, :2] = np.linalg.eigh(np.cov(points[:, :2].T))[1]
    local = (points - center) @ axes
    low, high = np.quantile(local, [config.stray_share, 1 - config.stray_share], axis=0)
    if (high - low)[:2].max() > config.max_length or high[2] - low[2] < config.min_height:
        return None
    corners = local[((local >= low) & (local <= high)).all(axis=1)]
    try:
        hull = ConvexHull(corners)
    except (QhullError, ValueError):
        return None
    reach = float(np.linalg.norm(corners, axis=1).max())
    floor = float(corners[:, 2].min()) + config.ground_clearance
    return CompactObject(instance, center, reach, axes, hull.equations, floor, float(hull.volume))
