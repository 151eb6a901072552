"""JSON from a file that may be damaged or hostile."""

from __future__ import annotations

import math
from typing import Any, NoReturn

from instdrive_core.files.json_value import parse_json

MAX_DEPTH = 32
"""Objects and lists within each other."""


def parse_bounded_json(text: bytes) -> Any:
    """Parse JSON of finite numbers. Raises ValueError for anything else, and for values nested too deep."""
    try:
        value = parse_json(text, parse_constant=_refuse, parse_float=_parse_finite)
    except RecursionError as error:
        raise ValueError(f"it is nested more than {MAX_DEPTH} deep") from error
    level, depth = [value], 1
    while level := [part for value in level for part in _list_parts(value)]:
        depth += 1
        if depth > MAX_DEPTH:
            raise ValueError(f"it is nested more than {MAX_DEPTH} deep")
    return value


def _list_parts(value: Any) -> list[Any]:
    """List the objects and lists directly inside an object or list."""
    parts = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return [part for part in parts if isinstance(part, dict | list)]


def _parse_finite(number: str) -> float:
    """Refuse numbers of so many digits that they become infinite."""
    value = float(number)
    return value if math.isfinite(value) else _refuse(number)


def _refuse(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number of JSON")
