"""The ground around a place as a picture from above: cells along and across the lane, with what lies in each."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numba
import numpy as np
from jaxtyping import Float, Float32, Float64, Int64
from numpy import ndarray

from instdrive_core.maths.rotations import matrix_from_quaternion, normalize_quaternions

_SIGMAS = 2.0
"""Splats count up to so many standard deviations from their middle …"""
_MAX_CELLS = 5
"""… and so many cells."""
_PIXEL = 0.25
"""Cells: the width of the filter that keeps splats smaller than a cell from falling between two."""


@dataclass(frozen=True)
class GroundGrid:
    """A lattice of square cells on the ground plane z = h + s · (x, y), seen from above."""

    corner: tuple[float, float]
    """World x and y (metres) of the outer corner of cell (0, 0)."""
    along: tuple[float, float]
    """Unit vector of the first axis, the lane's; the second one is turned left by 90°."""
    size: float
    """Metres per side of a cell."""
    shape: tuple[int, int]
    """Cells along and across; cells outside exist, but rasters do not show them."""
    plane: tuple[float, float, float]
    """Height (metres) of the ground plane at the world's origin, and its slopes along x and y."""

    @property
    def axes(self) -> Float64[ndarray, "2 2"]:
        """Rows: the unit vectors of the two axes in the world."""
        x, y = self.along
        return np.array([[x, y], [-y, x]])

    def compute_centers(self, cells: Int64[ndarray, "k 2"]) -> Float64[ndarray, "k 2"]:
        """World x and y of the cells' middles, metres."""
        return np.array(self.corner) + self.size * (cells + 0.5) @ self.axes

    def lift_to_ground(self, places: Float[ndarray, "k 2"]) -> Float64[ndarray, "k 3"]:
        """Points of the ground plane at these x and y."""
        return np.c_[places, self.plane[0] + places @ np.array(self.plane[1:])]

    def compute_corners(self, cells: Int64[ndarray, "k 2"]) -> Float64[ndarray, "k 4 3"]:
        """The four corners of each cell on the ground plane, in order around it."""
        steps = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        places = np.array(self.corner) + self.size * (cells[:, None] + steps) @ self.axes
        return self.lift_to_ground(places.reshape(-1, 2)).reshape(-1, 4, 3)

    def find_cells(self, points: Float[ndarray, "n d"]) -> Int64[ndarray, "n 2"]:
        """The cell of each point, which may lie outside of the shape."""
        return np.floor((points[:, :2] - np.array(self.corner)) @ self.axes.T / self.size).astype(np.int64)

    def compute_heights(self, points: Float[ndarray, "n 3"]) -> Float64[ndarray, " n"]:
        """Metres above the ground plane."""
        return points[:, 2] - self.plane[0] - points[:, :2] @ np.array(self.plane[1:])

    def contains(self, cells: Int64[ndarray, "n 2"]) -> ndarray:
        """Mask (n,) of the cells that the shape holds."""
        return np.all((cells >= 0) & (cells < self.shape), axis=1)

    def list_cells(self) -> Int64[ndarray, "c 2"]:
        """Every cell of the shape, row-major."""
        return np.argwhere(np.ones(self.shape, bool))

    def count_cells(self, cells: Int64[ndarray, "n 2"]) -> Int64[ndarray, "a b"]:
        """How many of `cells` name each cell of the shape."""
        flat = np.ravel_multi_index(tuple(cells[self.contains(cells)].T), self.shape)
        return np.bincount(flat, minlength=self.shape[0] * self.shape[1]).reshape(self.shape)


def refine_grid(grid: GroundGrid, factor: int) -> GroundGrid:
    """Divide each cell of a lattice into `factor` × `factor` cells."""
    return replace(grid, size=grid.size / factor, shape=(grid.shape[0] * factor, grid.shape[1] * factor))


@dataclass(frozen=True)
class GroundRaster:
    """Splats seen from above: cover and mean values of each cell of a grid."""

    cover: Float64[ndarray, "a b"]
    """Share of light that what lies there stops, 0 … 1."""
    values: Float64[ndarray, "a b v"]
    """Mean of the covering splats' values; 0 where nothing lies."""


def rasterize_ground(
    grid: GroundGrid,
    means: Float32[ndarray, "n 3"],
    quats: Float32[ndarray, "n 4"],
    scales: Float32[ndarray, "n 3"],
    opacities: Float32[ndarray, " n"],
    values: Float[ndarray, "n v"],
) -> GroundRaster:
    """Splats (metres; opacities in 0 … 1) seen from above, all at one depth: order does not count."""
    local = ((means[:, :2] - np.array(grid.corner)) @ grid.axes.T) / grid.size
    inverse, reach = _compute_footprints(grid, quats, scales)
    through, weights = np.ones(grid.shape), np.zeros(grid.shape)
    sums = np.zeros((*grid.shape, values.shape[1]))
    _add_splats(local, inverse, reach, opacities.astype(np.float64), values.astype(np.float64), through, weights, sums)
    return GroundRaster(1 - through, sums / np.maximum(weights, 1e-9)[..., None])


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _add_splats(
    local: ndarray,
    inverse: ndarray,
    reach: ndarray,
    opacities: ndarray,
    values: ndarray,
    through: ndarray,
    weights: ndarray,
    sums: ndarray,
) -> None:
    """Splat by splat: light that comes through, weights and weighted values of the cells in reach."""
    for row in range(len(local)):
        x, y = local[row]
        steps = min(int(reach[row]) + 1, _MAX_CELLS)
        along, across = int(np.floor(x)), int(np.floor(y))
        for i in range(max(along - steps, 0), min(along + steps + 1, through.shape[0])):
            for j in range(max(across - steps, 0), min(across + steps + 1, through.shape[1])):
                u, v = i + 0.5 - x, j + 0.5 - y
                square = inverse[row, 0, 0] * u * u + 2 * inverse[row, 0, 1] * u * v + inverse[row, 1, 1] * v * v
                if square < _SIGMAS**2:
                    alpha = opacities[row] * np.exp(-square / 2)
                    through[i, j] *= 1 - alpha
                    weights[i, j] += alpha
                    for column in range(values.shape[1]):
                        sums[i, j, column] += alpha * values[row, column]


def _compute_footprints(
    grid: GroundGrid, quats: Float32[ndarray, "n 4"], scales: Float32[ndarray, "n 3"]
) -> tuple[Float64[ndarray, "n 2 2"], Float64[ndarray, " n"]]:
    """Inverse covariances of the splats seen from above, in cells, and how many cells each reaches."""
    axes = np.zeros((2, 3))
    axes[:, :2] = grid.axes / grid.size
    spread = axes @ (matrix_from_quaternion(normalize_quaternions(quats)) * scales[:, None, :].astype(np.float64))
    covariances = spread @ spread.transpose(0, 2, 1) + _PIXEL**2 * np.eye(2)
    reach = _SIGMAS * np.sqrt(covariances[:, (0, 1), (0, 1)].max(axis=1))
    return np.linalg.inv(covariances), np.ceil(reach)
