"""Long lists of whole numbers in an edit's JSON (the rows that a lasso caught) are kept apart, as arrays.

An edit is JSON first and last: `packed` puts ``{"$array": NAME}`` where a long list was, `unpacked` puts the same list
back, so that no edit knows of it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Int64
from numpy import ndarray

LONG = 1024
"""Lists of fewer elements stay JSON."""
_KEY = "$array"

Numbers = Int64[ndarray, "n"] | Int64[ndarray, "n k"]


def packed(entry: Any, keep: Callable[[Numbers], Any]) -> Any:
    """The JSON value with long lists, of numbers or of equally long rows of numbers, replaced.

    Args:
        entry: what `Edit.to_json` gave.
        keep: stores an array and returns what names it, as JSON.
    """
    if isinstance(entry, dict):
        return {key: packed(value, keep) for key, value in entry.items()}
    if not isinstance(entry, list | tuple):
        return entry
    numbers = _numbers(entry) if len(entry) >= LONG else None
    return [packed(value, keep) for value in entry] if numbers is None else {_KEY: keep(numbers)}


def unpacked(entry: Any, find: Callable[[Any], Numbers]) -> Any:
    """The inverse of `packed`; `find` returns the array that was kept under a name."""
    if isinstance(entry, list):
        return [unpacked(value, find) for value in entry]
    if not isinstance(entry, dict):
        return entry
    if entry.keys() == {_KEY}:
        return find(entry[_KEY]).tolist()
    return {key: unpacked(value, find) for key, value in entry.items()}


def _numbers(values: list[Any] | tuple[Any, ...]) -> Numbers | None:
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
