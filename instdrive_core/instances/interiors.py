"""What photos never show: Gaussians inside of objects and behind surfaces get the ID of what they belong to.

Without it a deleted car uncovers its own inside: road and walls seen through it, floaters that only it ever hid.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numba
import numpy as np
from jaxtyping import Bool, Float, Float64, Int64, UInt16
from numpy import ndarray
from scipy.sparse import csc_array, csr_array
from scipy.spatial import ConvexHull, KDTree, QhullError

from instdrive_core.maths.groups import split_by_group

TALLEST_VEHICLE = 4.3
"""Metres."""


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
    larger_stray_shares: tuple[float, ...] = (0.02, 0.05, 0.1)
    """What is left out instead, one after the other, until the rest is a compact object: a few splats far behind a
    small object must not hide that it is one."""
    min_opacity: float = 0.1
    """Fainter Gaussians do not count for a hull."""
    ground_clearance: float = 0.1
    """Metres above the hull's lowest point that stay what they are: there lies the road."""
    growth: float = 1.15
    """Factor by which the hull is grown …"""
    margin: float = 0.2
    """… and metres on top, to find Gaussians close around it …"""
    min_share: float = 0.3
    """… which belong to the object that got at least this share of their votes …"""
    min_share_hidden: float = 0.15
    """… or this share, where photos show less of them than of half of all Gaussians, and they do not lie below it."""
    unseen_share: float = 0.01
    """Share of the votes that every object is taken to have when several claim a Gaussian."""


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
    shown: Float[ndarray, " n"],
    config: InteriorConfig = DEFAULT_CONFIG,
) -> Int64[ndarray, " n"]:
    """Give `candidates` inside the convex hull of a compact group to that group.

    Those close around it that partly show the group join, too: an object's edge, which votes lost to what is behind,
    and its hidden sides, of which photos show so little that stray votes decide. Where several groups claim a Gaussian,
    the likeliest wins (Bayes): its share of the votes times the density of its Gaussians, 1 / volume.

    Args:
        groups: -1 = none.
        means: metres, z up.
        opacities: in [0, 1].
        candidates: Gaussians of the background; hulls are made of these, too.
        shares: (n, g) of each Gaussian's votes, the groups' shares.
        shown: blending weight of each Gaussian, summed over the pixels of all photos.
    """
    filled, rows = groups.copy(), np.flatnonzero(candidates)
    tree, shares_of_group = KDTree(means[rows]), csc_array(shares)
    hidden, best = _find_hidden(shown), np.zeros(len(groups))
    for body in _find_compact_objects(groups, means, opacities, rows, config):
        reach = config.growth * body.reach + 2 * config.margin
        near = rows[np.sort(tree.query_ball_point(body.center, reach))]
        local = (means[near] - body.center) @ body.axes
        share = shares_of_group[:, [body.instance]].toarray()[near, 0]
        above = local[:, 2] > body.floor
        partly = (share >= config.min_share) | (hidden[near] & above & (share >= config.min_share_hidden))
        inside, close = body.holds(local) & above, body.holds(local, config.growth, config.margin) & partly
        likelihood = (share + config.unseen_share) / body.volume
        won = (inside | close) & (likelihood > best[near])
        filled[near[won]], best[near[won]] = body.instance, likelihood[won]
    return filled


def _find_hidden(shown: Float[ndarray, " n"]) -> Bool[ndarray, " n"]:
    """Find Gaussians of which photos show less than of half of those that they show at all."""
    seen = shown[shown > 0]
    return shown < np.median(seen) if len(seen) else np.ones(len(shown), bool)


def _find_compact_objects(
    groups: Int64[ndarray, " n"],
    means: Float[ndarray, "n 3"],
    opacities: Float[ndarray, " n"],
    rows: Int64[ndarray, " k"],
    config: InteriorConfig,
) -> list[CompactObject]:
    solid = rows[(groups[rows] >= 0) & (opacities[rows] >= config.min_opacity)]
    bodies = []
    for number, members in split_by_group(groups, solid):
        if len(members) >= config.min_gaussians:
            body = _fit_despite_strays(number, means[members].astype(np.float64), config)
            bodies += [] if body is None else [body]
    return bodies


def _fit_despite_strays(instance: int, points: Float64[ndarray, "k 3"], config: InteriorConfig) -> CompactObject | None:
    """Fit the compact object that most of the points span, leaving out as few strays as need be."""
    for share in (config.stray_share, *config.larger_stray_shares):
        body = fit_compact_object(instance, points, replace(config, stray_share=share))
        if body is not None:
            return body
    return None


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
