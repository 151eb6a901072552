"""Adding entries to a palette for several groups of rows: either all of them, or none and an error for the user."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float, Int64, UInt16
from numpy import ndarray

from instdrive_core.edits.document.row_parts import RowParts
from instdrive_core.errors import EditError
from instdrive_core.scene.entry_palette import EntryPalette, PaletteFullError

PartsChange = Callable[[Float[ndarray, "k w"], Int64[ndarray, " k"]], Float[ndarray, "k w"]]
"""Changes the values of k entries, each with the number of the part of rows that names it."""


def add_changed_entries(
    palette: EntryPalette, changes: Sequence[tuple[RowParts, Callable[[ndarray], ndarray]]]
) -> UInt16[ndarray, " m"]:
    """Add the changed entries of groups of rows; all parts of a group change in the same way.

    Returns the entry that each row should name instead: one group after the other, and in it one part after the other.

    Raises EditError, with nothing added, where they do not all fit.
    """
    size = len(palette)
    try:
        found = [palette.add_changes(parts.rows, parts.bounds, _change_each_once(change)) for parts, change in changes]
    except PaletteFullError as error:
        palette.truncate(size)
        raise _palette_full_error(error) from error
    return np.concatenate([np.zeros(0, np.uint16), *found])


def _change_each_once(change: Callable[[ndarray], ndarray]) -> PartsChange:
    def change_all(values: ndarray, _: ndarray) -> ndarray:
        known: dict[bytes, ndarray] = {}
        for entry in values:
            known.setdefault(entry.tobytes(), entry)
        changed = {key: change(entry.copy()) for key, entry in known.items()}
        return np.array([changed[entry.tobytes()] for entry in values])

    return change_all


def add_part_entries(palette: EntryPalette, parts: RowParts, change: PartsChange) -> UInt16[ndarray, " m"]:
    """Add the changed entries of parts of rows, each of which changes in its own way.

    Returns the entry that each row should name instead.

    Raises EditError, with nothing added, where they do not all fit.
    """
    try:
        return palette.add_changes(parts.rows, parts.bounds, change)
    except PaletteFullError as error:
        raise _palette_full_error(error) from error


def _palette_full_error(error: PaletteFullError) -> EditError:
    return EditError(f"{error}; export the scene and open the export to start afresh")
