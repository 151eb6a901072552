"""Splats that no photo was the reason for: the column that marks them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Int64
from numpy import ndarray

from instdrive_core.edits.document.document import Document

SYNTHETIC = "synthetic"
"""Name of the per-splat column that is above 0 for splats no photo was the reason for: 1 for those that fill holes,
`SHADOW` for shadows, `MIRRORED` for sides that were mirrored. Also the class of what fills holes."""
SHADOW = 2
"""Value of that column for the splats of a shadow that was laid below a thing."""
MIRRORED = 3
"""Value of that column for the splats of a side that nobody saw, mirrored from the other one."""


def find_shadow(document: Document, rows: Int64[ndarray, " n"]) -> Bool[ndarray, " n"]:
    """Find which rows are of shadows that were laid."""
    column = document.scene.extra.get(SYNTHETIC)
    return np.zeros(len(rows), bool) if column is None else column[rows] == SHADOW


def drop_shadows(document: Document, rows: Int64[ndarray, " n"]) -> Int64[ndarray, " m"]:
    """Drop the rows of shadows that were laid."""
    return rows if SYNTHETIC not in document.scene.extra else rows[~find_shadow(document, rows)]
