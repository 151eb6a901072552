"""Adding entries to a palette for several groups of rows: all of them, or none and an error for the user."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float, Int64, UInt16
from numpy import ndarray

from instdrive_core.edits.document.row_parts import RowParts
from instdrive_core.errors import EditError
from instdrive_core.scene.entry_palette import EntryPalette, PaletteFullError

PartsChange = Callable[[Float[ndarray, "k w"], Int64[ndarray, " k"]], Float[ndarray, "k w"]]
"""What becomes of the values of k entries, each named by the part of the rows whose number it gets."""


def add_changed_entries(
    palette: EntryPalette, changes: Sequence[tuple[RowParts, Callable[[ndarray], ndarray]]]
) -> UInt16[ndarray, " m"]:
    """The entries that rows should name instead, added where they are new: one change after the other, and of each one
    part after the other, which all change in the same way.

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
    """The same for parts that change each in its own way.

    Raises EditError, with nothing added, where they do not all fit.
    """
    try:
        return palette.add_changes(parts.rows, parts.bounds, change)
    except PaletteFullError as error:
        raise _palette_full_error(error) from error


def _palette_full_error(error: PaletteFullError) -> EditError:
    return EditError(f"{error}; export the scene and open the export to start afresh")
