"""Long lists of whole numbers in an edit's JSON (the rows that a lasso caught) are kept apart, as arrays.

An edit is JSON first and last: `pack_lists` puts ``{"$array": NAME}`` where `Edit.to_json` has a long list, and
`unpack_lists` puts the list back, so that no edit knows of it. Rows are never made a list on the way out: half a
million of them would hold up every other thread.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Int64
from numpy import ndarray

from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.document.row_runs import RowRuns

LONG = 1024
"""Lists of fewer elements stay JSON."""
_KEY = "$array"

Numbers = Int64[ndarray, "n"] | Int64[ndarray, "n k"]


def pack_lists(value: Any, keep: Callable[[Numbers], Any]) -> Any:
    """An edit as JSON, with long lists, of numbers or of equally long rows of numbers, replaced.

    Args:
        value: an edit, or a part of one.
        keep: stores an array and returns what names it, as JSON.
    """
    if isinstance(value, Edit):
        value = value.get_parameters()
    if isinstance(value, dict):
        return {key: pack_lists(part, keep) for key, part in value.items()}
    if isinstance(value, RowRuns):
        is_long = len(value.starts) >= LONG
        return {_KEY: keep(np.stack([value.starts, value.lengths], axis=1))} if is_long else value.to_json()
    if not isinstance(value, list | tuple):
        return value
    numbers = _find_numbers(value) if len(value) >= LONG else None
    return [pack_lists(part, keep) for part in value] if numbers is None else {_KEY: keep(numbers)}


def unpack_lists(entry: Any, find: Callable[[Any], Numbers]) -> Any:
    """The inverse of `pack_lists`; `find` returns the array that was kept under a name."""
    if isinstance(entry, list):
        return [unpack_lists(value, find) for value in entry]
    if not isinstance(entry, dict):
        return entry
    if entry.keys() == {_KEY}:
        return find(entry[_KEY]).tolist()
    return {key: unpack_lists(value, find) for key, value in entry.items()}


def _find_numbers(values: list[Any] | tuple[Any, ...]) -> Numbers | None:
    kinds = set(map(type, values))
    if kinds <= {list, tuple}:
        kinds = {type(value) for row in values for value in row}
    if kinds != {int}:
        return None
    try:
        numbers = np.array(values, np.int64)
    except (ValueError, OverflowError):  # rows of different lengths, or numbers of more than 64 bits
        return None
    return numbers if numbers.ndim in (1, 2) else None
