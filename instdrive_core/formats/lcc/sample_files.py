"""A small .lcc scene, written by the layout's description: for tests and fuzzing."""

import json
from typing import Any

import numpy as np

from instdrive_core.formats.lcc.meta import (
    DATA,
    ENVIRONMENT,
    ENVIRONMENT_RECORD,
    HARMONICS,
    HARMONICS_RECORD,
    INDEX,
    RECORD,
)


def build_lcc(rng, squares=(40, 20), levels=2, environment=0, harmonics=True):
    """Content by name: squares of so many splats at the finest level, half as many at each further one."""
    rows, index = 0, b""
    for number, count in enumerate(squares):
        index += np.array([number, -number], "<i2").tobytes()
        for level in range(levels):
            points = count >> level
            index += np.array([points], "<i4").tobytes() + np.array([rows * RECORD.itemsize], "<i8").tobytes()
            index += np.array([points * RECORD.itemsize], "<i4").tobytes()
            rows += points
    attributes = [
        {"name": "scale", "min": [1e-4, 2e-4, 3e-4], "max": [0.5, 0.6, 0.7]},
        {"name": "shcoef", "min": [-1.0, -1.1, -1.2], "max": [1.3, 1.4, 1.5]},
        {"name": "envscale", "min": [1.0, 1.0, 1.0], "max": [9.0, 8.0, 7.0]},
    ]
    meta = {
        "version": "5.0",
        "totalLevel": levels,
        "splats": [sum(count >> level for count in squares) for level in range(levels)],
        "fileType": "Quality" if harmonics else "Portable",
        "attributes": attributes,
    }
    content = {"meta.lcc": json.dumps(meta).encode(), INDEX: index, DATA: _draw(rng, RECORD, rows).tobytes()}
    if harmonics:
        content[HARMONICS] = _draw(rng, HARMONICS_RECORD, rows).tobytes()
    if environment:
        content[ENVIRONMENT] = _draw(rng, ENVIRONMENT_RECORD if harmonics else RECORD, environment).tobytes()
    return content


def write_lcc(folder, content):
    """Write the files into a new folder."""
    folder.mkdir(parents=True)
    for name, data in content.items():
        (folder / name).write_bytes(data)
    return folder


def _draw(rng, record, count):
    rows: Any = np.frombuffer(rng.bytes(count * record.itemsize), record).copy()
    splats = rows["splat"] if record is ENVIRONMENT_RECORD else rows
    if "position" in (splats.dtype.names or ()):
        splats["position"] = rng.normal(0, 20, (count, 3))
        splats["color"] = rng.integers(1, 255, (count, 4))
        splats["rotation"] = _pack_rotations(rng.normal(size=(count, 4)))
    return rows


def _pack_rotations(quats):
    """Words of quaternions xyzw."""
    quats = quats / np.linalg.norm(quats, axis=1, keepdims=True)
    largest = np.abs(quats).argmax(axis=1)
    quats = quats * np.sign(np.take_along_axis(quats, largest[:, None], axis=1))
    places = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])[largest]
    smaller = np.take_along_axis(quats, places, axis=1)
    steps = np.rint((smaller + np.sqrt(0.5)) / np.sqrt(2) * 1023).astype(np.uint32)
    return steps[:, 0] | steps[:, 1] << 10 | steps[:, 2] << 20 | largest.astype(np.uint32) << 30
