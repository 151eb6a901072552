"""The upright box and the convex hull around one instance's Gaussians, without what floats about it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64, Int64
from numpy import ndarray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, KDTree, QhullError

STRAY_SHARE = 0.02
"""Share of the Gaussians left out at each face of a box: those that reach farthest are mostly haze."""
MIN_SIZE = 0.001
"""Units: no side of a box is shorter, so that a box is never empty."""
MIN_PART = 0.1
"""Pieces with less than this share of the largest piece's Gaussians are floaters."""
GAP = 1 / 8
"""Pieces are apart by about this share of the instance's length, at least."""
SPARSE = 4000
"""Gaussians up to which their spacing is looked at, too; more of them lie closer than the gap."""
SEARCHED = 2000
"""Gaussians, evenly chosen, on which the yaw is looked for."""


@dataclass(frozen=True)
class OrientedBox:
    """A box that stands upright."""

    center: Float64[ndarray, "3"]
    size: Float64[ndarray, "3"]
    """Lengths along the box's own x, y and z, metres."""
    yaw: float
    """Radians from the frame's x axis to the box's, counter-clockwise about z, in (-π, π]."""

    @property
    def rotation(self) -> Float64[ndarray, "3 3"]:
        """Columns are the box's axes."""
        return _build_rotation(self.yaw)

    def holds(self, points: Float[ndarray, "n 3"], slack: float = 0.0) -> Bool[ndarray, " n"]:
        """Whether each point lies inside, or outside by at most `slack` metres."""
        return np.all(np.abs((points - self.center) @ self.rotation) <= self.size / 2 + slack, axis=1)


def find_main_parts(means: Float64[ndarray, "n 3"]) -> Bool[ndarray, " n"]:
    """Find the Gaussians that are no floaters; these are pieces far from the rest that hold few Gaussians.

    Pieces are cells of an eighth of the middle 94 % that touch; where Gaussians are sparse, larger cells.
    """
    low, high = np.quantile(means, [0.03, 0.97], axis=0, method="nearest")
    cell = GAP * float((high - low).max())
    if len(means) <= SPARSE:
        cell = max(cell, 2 * _measure_spacing(means))
    if cell <= 0 or not math.isfinite(cell):
        return np.ones(len(means), bool)
    # Limited, as a stray at 1e30 m has no whole number of cells.
    cells = np.floor(np.clip((means - low) / cell, -(2.0**40), 2.0**40))
    cells, owner = np.unique(cells, axis=0, return_inverse=True)
    pairs = KDTree(cells).query_pairs(1.8, output_type="ndarray")
    links = coo_array((np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), shape=(len(cells), len(cells)))
    piece = connected_components(links, directed=False)[1][owner.reshape(-1)]
    counts = np.bincount(piece)
    largest = int(counts.max())
    return (counts >= max(MIN_PART * largest, 2 if largest >= 4 else 1))[piece]


def fit_upright_box(
    means: Float64[ndarray, "n 3"], covariances: Float64[ndarray, "n 3 3"], yaw: float | None = None
) -> OrientedBox:
    """Fit a box to all Gaussians but the farthest 2 % at each face, each as wide as its standard deviation.

    Args:
        means: (n ≥ 1) finite, in the frame's unit, z up.
        covariances: of the Gaussians, in the same frame.
        yaw: direction of the box's x axis; by default that of the rectangle with the smallest area seen from above,
            whose longer side is x, in (-π/2, π/2].
    """
    if yaw is None:
        chosen = np.linspace(0, len(means) - 1, min(len(means), SEARCHED)).astype(int)
        yaw = _find_smallest_rectangle(means[chosen], covariances[chosen])
        low, high = _measure_extents(means, covariances, _build_rotation(yaw))
        if high[1] - low[1] > high[0] - low[0]:
            yaw += math.pi / 2
        yaw = math.pi / 2 - (math.pi / 2 - yaw) % math.pi
    axes = _build_rotation(yaw)
    low, high = _measure_extents(means, covariances, axes)
    return OrientedBox(axes @ ((low + high) / 2), np.maximum(high - low, MIN_SIZE), yaw)


def compute_convex_hull(
    points: Float64[ndarray, "n 3"],
) -> tuple[Float64[ndarray, "v 3"], Int64[ndarray, "f 3"]] | None:
    """Compute a hull's corners and triangles (counter-clockwise from outside); None where points span no volume."""
    center = points.mean(axis=0) if len(points) else np.zeros(3)
    try:
        hull = ConvexHull(points - center)
    except (QhullError, ValueError):
        return None
    corners = points[hull.vertices]
    number = np.zeros(len(points), np.int64)
    number[hull.vertices] = np.arange(len(hull.vertices))
    faces = number[hull.simplices]
    sides = corners[faces]
    normals = np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0])
    inward = np.einsum("fi,fi->f", normals, hull.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return corners, faces


def _find_smallest_rectangle(means: Float64[ndarray, "n 3"], covariances: Float64[ndarray, "n 3 3"]) -> float:
    """The angle in [0, π/2), to 0.05°, at which length × width is smallest."""
    angles = np.deg2rad(np.arange(0, 90, 1.0))
    best = angles[np.argmin(_compute_areas(means, covariances, angles))]
    near = best + np.deg2rad(np.arange(-1, 1.001, 0.05))
    return float(near[np.argmin(_compute_areas(means, covariances, near))]) % (math.pi / 2)


def _compute_areas(
    means: Float64[ndarray, "n 3"], covariances: Float64[ndarray, "n 3 3"], angles: Float64[ndarray, " a"]
) -> Float64[ndarray, " a"]:
    """Length × width of the rectangle at each angle; as `_measure_extents` measures them, for many angles at once."""
    sides = []
    for x, y in ((np.cos(angles), np.sin(angles)), (-np.sin(angles), np.cos(angles))):
        products = np.stack([x * x, 2 * x * y, y * y])
        reach = np.sqrt(np.maximum(covariances[:, (0, 0, 1), (0, 1, 1)] @ products, 0))
        low, high = _trim_strays(means[:, :2] @ np.stack([x, y]), reach)
        sides.append(high - low)
    return sides[0] * sides[1]


def _measure_extents(
    means: Float64[ndarray, "n 3"], covariances: Float64[ndarray, "n 3 3"], axes: Float64[ndarray, "3 a"]
) -> tuple[Float64[ndarray, " a"], Float64[ndarray, " a"]]:
    """Lowest and highest coordinate along each axis (a column) without strays."""
    places = means @ axes
    reach = np.sqrt(np.maximum(((covariances @ axes) * axes).sum(axis=1), 0))
    return _trim_strays(places, reach)


def _trim_strays(
    places: Float64[ndarray, "n a"], reach: Float64[ndarray, "n a"]
) -> tuple[Float64[ndarray, " a"], Float64[ndarray, " a"]]:
    low = np.quantile(places - reach, STRAY_SHARE, axis=0, method="nearest")
    high = np.quantile(places + reach, 1 - STRAY_SHARE, axis=0, method="nearest")
    return low, high


def _measure_spacing(means: Float64[ndarray, "n 3"]) -> float:
    """The median distance to the fourth neighbour, or the farthest there is."""
    if len(means) < 2:
        return 0.0
    distances, _ = KDTree(means).query(means, k=min(5, len(means)))
    return float(np.median(distances[:, -1]))


def _build_rotation(yaw: float) -> Float64[ndarray, "3 3"]:
    cos, sin = math.cos(yaw), math.sin(yaw)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
