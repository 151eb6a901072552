"""Ways of vehicles as JSON files: keys with times."""

from __future__ import annotations

import math
from pathlib import Path

from instdrive_core.errors import DataError
from instdrive_core.files.json_fields import read_json, require_field, require_number
from instdrive_core.scene.vehicle_path import PathKey


def read_way(file: Path) -> tuple[PathKey, ...]:
    """Read the keys of a way: an object with `keys`, each with `time`, `x`, `y` and if wanted `heading` in degrees.

    Raises DataError naming the field that is wrong.
    """
    keys = require_field(file, read_json(file), "keys")
    if not isinstance(keys, list) or not keys:
        raise DataError(file, "the field 'keys' holds no key", "Write a list of objects with time, x and y")
    found = []
    for number, entry in enumerate(keys):
        values = [
            require_number(file, require_field(file, entry, name, f"keys[{number}]."), f"keys[{number}].{name}")
            for name in ("time", "x", "y")
        ]
        turn = entry.get("heading")
        name = f"keys[{number}].heading"
        heading = None if turn is None else math.radians(require_number(file, turn, name))
        found.append(PathKey(values[0], values[1], values[2], heading))
        if number and found[-1].time <= found[-2].time:
            raise DataError(file, f"the field 'keys[{number}].time' is not above the one before", "Sort the keys")
    return tuple(found)
