"""The splats that a camera sees, nearest first, each in one cache line: what binning and blending a preview read."""

from __future__ import annotations

from copy import copy

import numba
import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from instdrive_core.maths.sorting import sort_in_parallel
from instdrive_core.maths.workspace import Workspace
from instdrive_core.rasterize.kernels.fragment import EIGHTH, FAST
from instdrive_core.rasterize.kernels.project import (
    CONIC_XX,
    DEPTH,
    MEAN_X,
    MEAN_Y,
    OPACITY,
    POWER_LIMIT,
    SPLAT_WIDTH,
    project_rows,
)
from instdrive_core.rasterize.kernels.settings import RasterSettings
from instdrive_core.rasterize.kernels.simd import prefetch
from instdrive_core.scene.camera import Camera

SPLAT_FLOATS = 16
"""Per splat: one cache line."""
# Its columns. The exponent at offset d from the mean is base - (a·dx + b·dy)² - (c·dy)²; the mean is relative to the
# centre of pixel (0, 0). Then opacity and the row, as the bits of an int32; depth and colour, which are blended; the 2D
# covariance and the power limit, from which its tiles follow.
AT_A, AT_B, AT_X, AT_C, AT_Y, AT_BASE, AT_OPACITY, AT_ROW, AT_VALUES = (np.uint64(k) for k in range(9))
AT_COV_XX, AT_COV_XY, AT_COV_YY, AT_LIMIT = (np.uint64(k) for k in range(12, 16))
_LINE_COVARIANCE, _LINE_COLOR = np.uint64(SPLAT_WIDTH), np.uint64(SPLAT_WIDTH + 3)
_AHEAD = np.uint64(12)
"""So many places ahead the next lines are fetched."""


class ProjectedSplats:
    """Splats projected in the order of their rows, a cache line each: sorting them reads memory at random."""

    def __init__(self, count: int, workspace: Workspace) -> None:
        self.lines = workspace.get_array("projected splats", (count, SPLAT_FLOATS))
        """Columns of `Projection.splats`, then its covariances, then room for the colour."""
        self.depths = workspace.get_array("projected depths", (count,))
        """0 for invisible ones, whose lines are undefined."""

    def take_part(self, start: int, end: int) -> ProjectedSplats:
        """Take the rows from `start` to before `end`; a view."""
        part = copy(self)
        part.lines, part.depths = self.lines[start:end], self.depths[start:end]
        return part

    @property
    def splats(self) -> Float32[ndarray, "n 8"]:
        """Splats in the columns of `Projection.splats`; a view."""
        return self.lines[:, :SPLAT_WIDTH]

    @property
    def covariances(self) -> Float32[ndarray, "n 3"]:
        """Covariances in the columns of `Projection.covariances`; a view."""
        return self.lines[:, int(_LINE_COVARIANCE) : int(_LINE_COLOR)]

    @property
    def colors(self) -> Float32[ndarray, "n 3"]:
        """RGB, to be written for the visible rows; a view."""
        return self.lines[:, int(_LINE_COLOR) : int(_LINE_COLOR) + 3]


def project_splats(
    means: Float32[ndarray, "n 3"],
    quats: Float32[ndarray, "n 4"],
    log_scales: Float32[ndarray, "n 3"],
    opacities: Float32[ndarray, " n"],
    camera: Camera,
    settings: RasterSettings,
    workspace: Workspace,
) -> ProjectedSplats:
    """Project and cull as `project` does, neither sorted nor copied; the arrays are the workspace's."""
    result = ProjectedSplats(len(means), workspace)
    project_rows(
        *(means, quats, log_scales, opacities, camera, settings),
        *(result.splats, result.covariances, result.depths),
    )
    return result


def pack_splats(found: ProjectedSplats, settings: RasterSettings, workspace: Workspace) -> Float32[ndarray, "v 16"]:
    """Pack the visible splats nearest first, equal depths in row order."""
    order = sort_in_parallel(found.depths, workspace)
    packed = workspace.get_array("packed splats", (len(order), SPLAT_FLOATS))
    _pack(order, found.lines, settings.to_row(), packed, packed.view(np.int32))
    return packed


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy", fastmath=FAST)
def _pack(order, lines, constants, packed, packed_bits):
    count, flat, half = np.uint64(len(order)), lines.reshape(-1), np.float32(0.5)
    scale, faintest = half * EIGHTH, np.float32(0.125) * np.log2(constants[2])
    for place in numba.prange(len(order)):
        v, row = np.uint64(place), np.uint64(order[place])
        ahead = np.uint64(order[min(v + _AHEAD, count - np.uint64(1))])
        prefetch(flat, ahead * np.uint64(SPLAT_FLOATS))
        limit, yy = lines[row, POWER_LIMIT], lines[row, _LINE_COVARIANCE + np.uint64(2)]
        a = np.sqrt(scale * lines[row, CONIC_XX])
        packed[v, AT_A], packed[v, AT_B] = a, -a * lines[row, _LINE_COVARIANCE + np.uint64(1)] / yy
        packed[v, AT_C], packed[v, AT_BASE] = np.sqrt(scale / yy), scale * limit + faintest
        packed[v, AT_X], packed[v, AT_Y] = lines[row, MEAN_X] - half, lines[row, MEAN_Y] - half
        packed[v, AT_OPACITY], packed[v, AT_LIMIT] = lines[row, OPACITY], limit
        packed[v, AT_VALUES] = lines[row, DEPTH]
        for channel in range(np.uint64(3)):
            packed[v, AT_VALUES + np.uint64(1) + channel] = lines[row, _LINE_COLOR + channel]
            packed[v, AT_COV_XX + channel] = lines[row, _LINE_COVARIANCE + channel]
        packed_bits[v, AT_ROW] = order[place]
