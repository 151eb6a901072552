"""Values of a bundle's JSON, required to be what they should; errors name the bundle and the field."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.formats.splatsim.layout import REMEDY

_LARGEST = 1e9


def take(path: Path, holder: Any, key: str, kind: type, where: str) -> Any:
    """Take ``holder[key]`` of a kind. Raises DataError where it is missing or of another kind."""
    value = holder.get(key) if isinstance(holder, dict) else None
    if not isinstance(value, kind) or isinstance(value, bool) != (kind is bool):
        raise DataError(path, f"'{key}' of {where} is {str(value)[:60]!r}, not a {kind.__name__}", REMEDY)
    return value


def take_vector(path: Path, holder: Any, key: str, length: int, where: str) -> Float64[ndarray, " {length}"]:
    """Take a list of finite numbers. Raises DataError where it is none of `length`."""
    value = take(path, holder, key, list, where)
    numbers = [number for number in value if isinstance(number, int | float) and not isinstance(number, bool)]
    if len(value) != length or len(numbers) != length or not all(abs(number) < _LARGEST for number in numbers):
        raise DataError(path, f"'{key}' of {where} is {str(value)[:60]}, not {length} numbers", REMEDY)
    return np.array(numbers, np.float64)


def require_equal(path: Path, value: Any, expected: Any, what: str) -> None:
    """Require what a document declares. Raises DataError where it declares anything else."""
    if value != expected:
        problem = f"{what} is {str(value)[:80]!r}, expected {str(expected)[:80]!r}"
        raise DataError(path, problem, "Export it again with a current 3dgs_io")
