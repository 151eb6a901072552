"""Ground that hangs together: cells reached from sure ground without a step, and the surface between and beyond them.

Where cars stand close, as in a jam, LiDAR sees more of bonnets and roofs than of the road between them, and what is
low there is not the ground. A roof ends where the car does, though, and rises from the road in a step; ground goes on.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray
from scipy import ndimage, sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import spsolve

SMOOTH_REACH, SMOOTH_STEP, SMOOTH_SLOPE = 1.0, 0.05, 0.06
"""Metres within which cells are joined to smooth pieces, and by which their heights may differ: at once, per metre."""
SURE_AREA, SURE_WIDTH = 25.0, 4.0
"""Square metres and metres across from which on a smooth piece is ground: wider than any vehicle's roof."""
SHARE_OF_LARGEST, LOW_RISE = 0.3, 0.3
"""Where no piece is so large: of those that have this share of the largest one's area, the lowest is ground, and what
lies at most so many metres higher."""
GAPS = (1.5, 3.0, 6.0)
"""Metres that ground may go on behind, the small ones first: beyond hidden strips wider than a car it is guessed."""
STEP, SLOPE = 0.08, 0.04
"""Metres that a cell may stand above the nearest ground, at once and per metre to it; a bonnet stands 0.7 m higher."""
BLOCK = 4
"""Cells along an edge of the blocks between which the surface is drawn."""
BENDING, TILTING = 10.0, 0.3
"""Weights of curvature and slope against a known block's height: the surface is stiff over a few blocks, and levels out
over ten or so where nothing is known."""


def select_connected(
    lowest: Float64[ndarray, "x y"], ground: Bool[ndarray, "x y"], cell: float
) -> Bool[ndarray, "x y"]:
    """Select the cells of `ground` that hang together with sure ground.

    Args:
        lowest: height of each cell's lowest points in metres, NaN where none lies.
        ground: cells that may be ground.
        cell: metres along an edge of a cell.
    """
    if not ground.any():
        return ground
    reached = _find_sure_ground(lowest, ground, cell)
    for gap in GAPS:
        while True:
            nearest = np.asarray(ndimage.distance_transform_edt(~reached, return_distances=False, return_indices=True))
            away = cell * np.linalg.norm(nearest - np.indices(ground.shape), axis=0)
            rise = lowest - lowest[tuple(nearest)]
            new = ground & ~reached & (away <= gap) & (rise <= STEP + SLOPE * away)
            if not new.any():
                break
            reached |= new
    return reached


def _find_sure_ground(lowest: Float64[ndarray, "x y"], ground: Bool[ndarray, "x y"], cell: float) -> ndarray:
    """Cells of smooth pieces larger than a vehicle; where there are none, of the lowest among the large ones."""
    rows, columns = np.nonzero(ground)
    pieces = _join_smooth_pieces(lowest, ground, cell)
    counts = np.bincount(pieces)
    across = _measure_widths(np.column_stack([rows, columns]) * cell, pieces) + cell
    is_large = (counts * cell**2 >= SURE_AREA) & (across >= SURE_WIDTH)
    if not is_large.any():
        levels = np.bincount(pieces, lowest[ground]) / counts
        is_large = counts >= SHARE_OF_LARGEST * counts.max()
        is_large &= levels <= levels[is_large].min() + LOW_RISE
    sure = np.zeros_like(ground)
    sure[rows, columns] = is_large[pieces]
    return sure


def _join_smooth_pieces(
    lowest: Float64[ndarray, "x y"], ground: Bool[ndarray, "x y"], cell: float
) -> Int64[ndarray, " k"]:
    """Number of the smooth piece of each ground cell, in the order of `np.nonzero(ground)`."""
    numbers = np.full(ground.shape, -1)
    numbers[ground] = np.arange(ground.sum())
    reach = round(SMOOTH_REACH / cell)
    links = []
    for down in range(reach + 1):
        for right in range(-reach, reach + 1):
            away = np.hypot(down, right)
            if (down == 0 and right <= 0) or away > reach:
                continue
            here = slice(None, ground.shape[0] - down), slice(max(0, -right), ground.shape[1] - max(0, right))
            there = slice(down, None), slice(max(0, right), ground.shape[1] + min(0, right))
            step = np.abs(lowest[here] - lowest[there])
            joined = (numbers[here] >= 0) & (numbers[there] >= 0) & (step <= SMOOTH_STEP + SMOOTH_SLOPE * away * cell)
            links.append(np.stack([numbers[here][joined], numbers[there][joined]]))
    first, second = np.concatenate(links, axis=1)
    count = int(ground.sum())
    graph = sparse.coo_matrix((np.ones(len(first), bool), (first, second)), shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def _measure_widths(places: Float64[ndarray, "k 2"], pieces: Int64[ndarray, " k"]) -> Float64[ndarray, " p"]:
    """Metres across each piece, as if it were a rectangle evenly filled."""
    counts = np.bincount(pieces)
    middles = np.column_stack([np.bincount(pieces, axis) / counts for axis in places.T])
    off = places - middles[pieces]
    xx, yy, xy = (np.bincount(pieces, off[:, a] * off[:, b]) / counts for a, b in ((0, 0), (1, 1), (0, 1)))
    least = (xx + yy) / 2 - np.sqrt(((xx - yy) / 2) ** 2 + xy**2)
    return np.sqrt(12 * np.maximum(least, 0))


def drape_surface(heights: Float64[ndarray, "x y"]) -> Float64[ndarray, "x y"]:
    """Draw the smoothest surface through the known heights, over what is unknown, too.

    Raises ValueError where no height is known.
    """
    known = np.isfinite(heights)
    if not known.any():
        raise ValueError("no height to draw a surface through")
    padding = [(0, -size % BLOCK) for size in heights.shape]
    rows, columns = ((size + more[1]) // BLOCK for size, more in zip(heights.shape, padding, strict=True))

    def gather(values: ndarray) -> ndarray:
        return np.pad(values, padding).reshape(rows, BLOCK, columns, BLOCK).sum(axis=(1, 3))

    counts = gather(known)
    level = float(heights[known].mean())
    means = gather(np.where(known, heights - level, 0.0)) / np.maximum(counts, 1)
    weights = np.minimum(counts / BLOCK, 1.0).ravel()
    matrix = (_build_stiffness(rows, columns) + sparse.diags(weights)).tocsc()
    surface = spsolve(matrix, weights * means.ravel()).reshape(rows, columns) + level
    places = (np.indices(heights.shape) + 0.5) / BLOCK - 0.5
    return ndimage.map_coordinates(surface, places, order=1, mode="nearest")


def _build_stiffness(rows: int, columns: int) -> sparse.csr_matrix:
    """The quadratic form of a surface's curvature and slope (a thin plate under tension)."""
    slopes = [_difference(rows, 1), _difference(columns, 1)]
    curves = [_difference(rows, 2), _difference(columns, 2)]
    across, along = sparse.identity(columns), sparse.identity(rows)
    bends = [
        sparse.kron(curves[0], across), sparse.kron(along, curves[1]), np.sqrt(2) * sparse.kron(slopes[0], slopes[1]),
    ]  # fmt: skip
    tilts = [sparse.kron(slopes[0], across), sparse.kron(along, slopes[1])]
    form = sparse.csr_matrix((rows * columns, rows * columns))
    for weight, parts in ((BENDING, bends), (TILTING, tilts)):
        for part in parts:
            form = form + weight * (part.T @ part)
    return form


def _difference(count: int, order: int) -> sparse.csr_matrix:
    """Differences of neighbours, once or twice; no rows where there are too few."""
    rows = np.diff(np.eye(order + 1), n=order, axis=0)[0]
    bands = [value * sparse.eye(max(0, count - order), count, k=band) for band, value in enumerate(rows)]
    return sparse.csr_matrix(sum(bands[1:], bands[0]))
