"""The splats that a camera sees, each in one cache line: what binning and blending a preview read."""

from __future__ import annotations

from copy import copy

import numpy as np
from jaxtyping import Float32, Int32, UInt32
from numpy import ndarray

from instdrive_core.maths.workspace import Workspace

SPLAT_FLOATS = 16
"""Per splat: one cache line."""
# Its columns. The exponent at offset d from the mean is base - (a·dx + b·dy)² - (c·dy)²; the mean is relative to the
# centre of pixel (0, 0). Then opacity and the row, as the bits of an int32; depth and colour, which are blended; the
# number of its instance; the part of the 2D covariance that a, b and c leave open, and the power limit, from which its
# tiles follow.
AT_A, AT_B, AT_X, AT_C, AT_Y, AT_BASE, AT_OPACITY, AT_ROW, AT_VALUES = (np.uint64(k) for k in range(9))
AT_COV_XX, AT_COV_XY, AT_INSTANCE, AT_LIMIT = (np.uint64(k) for k in range(12, 16))
AT_COLOR = AT_VALUES + np.uint64(1)
MANY = np.float32(16)
"""Instead of bits of four tiles: more than these."""
NAMELESS = np.float32(-1)
"""Instead of the opacity: no pixel stands for this splat."""


NO_NAMES = np.zeros(0, np.int32)
NO_INSTANCES = np.zeros(0, np.uint32)


class ProjectedSplats:
    """Splats projected in the order of their rows; the arrays are the workspace's.

    Args:
        count: n.
        workspace: where the arrays are.
        names: rows of a scene that pixels of these splats stand for, -1 for those that no pixel stands for; empty: the
            numbers from 0 on.
        instances: instance of each of the scene's rows, which share a pixel's light; empty: all are of one.
    """

    def __init__(
        self,
        count: int,
        workspace: Workspace,
        names: Int32[ndarray, " k"] = NO_NAMES,
        instances: UInt32[ndarray, " m"] = NO_INSTANCES,
    ) -> None:
        self.first_row, self.names, self.instances = 0, names, instances
        """Number of the first of these splats, the scene's rows that they are named by, and all rows' instances."""
        self.lines = workspace.get_array("projected splats", (count, SPLAT_FLOATS))
        """A cache line each, in the columns above; undefined for invisible ones."""
        self.depths = workspace.get_array("projected depths", (count,))
        """Metres along the viewing axis; 0 for invisible ones."""
        self.tiles = workspace.get_array("projected tiles", (count, 4), np.uint16)
        """First column and row of the tiles that a splat may reach, and bits of which ones of the two in that row and
        the two below do; `MANY` instead where they are not all. Without bits for invisible ones."""

    def take_part(self, start: int, end: int) -> ProjectedSplats:
        """Take the rows from `start` to before `end`; a view."""
        part = copy(self)
        part.first_row, part.names = self.first_row + start, self.names[start:end]
        part.lines, part.depths, part.tiles = self.lines[start:end], self.depths[start:end], self.tiles[start:end]
        return part

    @property
    def colors(self) -> Float32[ndarray, "n 3"]:
        """RGB of the visible rows; a view."""
        return self.lines[:, int(AT_COLOR) : int(AT_COLOR) + 3]
