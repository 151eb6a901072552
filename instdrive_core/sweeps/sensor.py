"""Described sensors: a few well-known ones by name, others in a JSON file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from instdrive_core.errors import DataError, OptionError
from instdrive_core.files.json_fields import read_json, require_field, require_number, require_numbers
from instdrive_core.sweeps.pattern import Pattern

SENSORS: Mapping[str, Mapping[str, Any]] = {
    "VLP-16": {
        "beams": 16,
        "field_deg": [-15, 15],
        "columns": 1800,
        "rate_hz": 10,
        "range_m": [1, 100],
        "noise_m": 0.03,
    },
    "HDL-64E": {
        "beams": 64,
        "field_deg": [-24.8, 2],
        "columns": 2083,
        "rate_hz": 10,
        "range_m": [1, 120],
        "noise_m": 0.02,
    },
    "OS1-128": {
        "beams": 128,
        "field_deg": [-22.5, 22.5],
        "columns": 1024,
        "rate_hz": 10,
        "range_m": [0.5, 120],
        "noise_m": 0.02,
    },
    "PANDAR128": {
        "beams": 128,
        "field_deg": [-25, 15],
        "columns": 1800,
        "rate_hz": 10,
        "range_m": [0.3, 200],
        "noise_m": 0.02,
    },
}
"""Beams and ranges as makers state them; beams are taken to be even apart."""
OWN, NONE = "own", "none"
"""What is chosen instead of a described sensor: as the clip's sweeps show it, or no sweeps."""
_MOST_RAYS = 4_000_000
_REMEDY = "docs/recording.md describes the file"


def find_sensor(name: str) -> Pattern:
    """Find a sensor by name or file. Raises OptionError for neither, DataError for a file that is wrong."""
    if name in SENSORS:
        return build_pattern(Path(name), SENSORS[name])
    path = Path(name)
    if not path.is_file():
        raise OptionError(f"{name!r} is neither a file nor one of the sensors own, none, {', '.join(SENSORS)}")
    return build_pattern(path, read_json(path))


def build_pattern(file: Path, about: Any) -> Pattern:
    """Build the sweep of a described sensor that turns clockwise seen from above, its moment amid the turn.

    Args:
        file: named in errors.
        about: `columns` around; `elevations_deg`, or `beams` evenly over `field_deg` (lowest, highest); `rate_hz`;
            `range_m` (nearest, farthest); and if wanted `noise_m` and `place_m` (x forward, y left, z up from amid
            the cameras).

    Raises DataError naming the field that is wrong.
    """
    elevations = _read_elevations(file, about)
    columns = _read_count(file, about, "columns")
    if columns * len(elevations) > _MOST_RAYS:
        raise DataError(file, f"{columns} columns of {len(elevations)} beams are over {_MOST_RAYS:,} rays", "Use fewer")
    rate = require_number(file, require_field(file, about, "rate_hz"), "rate_hz")
    reach = require_numbers(file, require_field(file, about, "range_m"), "range_m")
    noise = require_number(file, about.get("noise_m", 0.0), "noise_m")
    place = require_numbers(file, about.get("place_m", [0.0, 0.0, 0.0]), "place_m")
    if not 0.1 <= rate <= 1000 or len(reach) != 2 or not 0 <= reach[0] < reach[1] or noise < 0 or len(place) != 3:
        problem = "rate_hz is not in 0.1 … 1000, range_m not two rising numbers, noise_m below 0, or place_m not three"
        raise DataError(file, problem, _REMEDY)
    shares = (np.arange(columns) + 0.5) / columns - 0.5
    azimuths = np.repeat(-2 * np.pi * shares, len(elevations))
    heights = np.tile(np.radians(elevations), columns)
    flat = np.cos(heights)
    directions = np.stack([flat * np.cos(azimuths), flat * np.sin(azimuths), np.sin(heights)], axis=1)
    delays = np.repeat(shares / rate, len(elevations))
    return Pattern(directions.astype(np.float32), delays.astype(np.float32), np.array(place), reach[0], reach[1], noise)


def _read_elevations(file: Path, about: Any) -> list[float]:
    if isinstance(about, dict) and "elevations_deg" in about:
        elevations = require_numbers(file, about["elevations_deg"], "elevations_deg")
    else:
        field = require_numbers(file, require_field(file, about, "field_deg"), "field_deg")
        if len(field) != 2 or field[0] >= field[1]:
            raise DataError(file, f"'field_deg' is {field}, not the lowest and the highest beam", _REMEDY)
        elevations = np.linspace(field[0], field[1], _read_count(file, about, "beams")).tolist()
    if not elevations or max(abs(each) for each in elevations) > 90:
        raise DataError(file, "the beams are none, or not from -90 to 90 degrees", _REMEDY)
    return elevations


def _read_count(file: Path, about: Any, name: str) -> int:
    value = require_field(file, about, name)
    if not isinstance(value, int) or isinstance(value, bool) or not 1 <= value <= _MOST_RAYS:
        raise DataError(file, f"the field '{name}' is {value!r}, expected a whole number from 1", _REMEDY)
    return value
