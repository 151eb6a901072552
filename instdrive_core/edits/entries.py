"""Adding entries to a palette for several groups of rows: all of them, or none and an error for the user."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import UInt16
from numpy import ndarray

from instdrive_core.errors import EditError
from instdrive_core.scene.entry_palette import EntryPalette, PaletteFullError

RowsChange = tuple[ndarray, Callable[[ndarray], ndarray]]
"""Rows, and what becomes of the values of the entries that they name."""


def changed_entries(palette: EntryPalette, parts: Sequence[RowsChange]) -> UInt16[ndarray, " m"]:
    """The entries that the rows of all parts, one part after the other, should name instead, added where they are new.

    Raises EditError, with nothing added, where they do not all fit.
    """
    size = len(palette)
    try:
        entries = [palette.add_changed(rows, change) for rows, change in parts]
    except PaletteFullError as error:
        palette.truncate(size)
        raise EditError(f"{error}; export the scene and open the export to start afresh") from error
    return np.concatenate([np.zeros(0, np.uint16), *entries])
