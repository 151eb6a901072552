"""Checks before a file of one moment is written: no moving actors, and only numbers that the format can hold."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.scene.scene import Scene


def check_static(path: str | Path, scene: Scene, suffix: str) -> None:
    """Check that nothing moves in a scene. Raises DataError: `edits.queries.bake.freeze_at_time` places actors."""
    if scene.actors:
        problem = f"a {suffix} holds one moment, the scene has {len(scene.actors)} actors that move"
        raise DataError(path, problem, "Say the time to export (--time), or save to a folder, which keeps the tracks")


def check_numbers(path: str | Path, name: str, values: ndarray, rows: ndarray, allow_infinite: bool = False) -> None:
    """Check numbers before they are quantised: none may be NaN, or infinite where no limit stands for it.

    Args:
        path: the file to be written.
        name: what the values are, for the message.
        values: (m, …) floats of `rows`.
        rows: (m,) splat numbers, for the message.
        allow_infinite: whether only NaN is wrong.

    Raises DataError for the first wrong number.
    """
    wrong = np.isnan(values) if allow_infinite else ~np.isfinite(values)
    if not wrong.any():
        return
    place = tuple(np.argwhere(wrong)[0])
    problem = f"{name} of splat {rows[place[0]]} is {values[place]}, which this format cannot hold"
    raise DataError(path, problem, "Delete the damaged splats, or save as .ply, which keeps every value")
