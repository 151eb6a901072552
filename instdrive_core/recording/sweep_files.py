"""LiDAR sweeps of a recording: the seam to whatever casts them, and their files.

A `CastSweep` gives the sweep of a moment; `record_drive` writes what it gives as ``lidar/NN.npz``.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Float64, UInt32
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import write_bytes


@dataclass(frozen=True)
class MomentSweep:
    """One turn of the LiDAR, relative to the scene's origin."""

    points: Float32[ndarray, "n 3"]
    """World coordinates in metres."""
    intensity: Float32[ndarray, " n"]
    """[0, 1]."""
    times: Float64[ndarray, " n"]
    """When each point was measured, seconds as the scene counts them."""
    instances: UInt32[ndarray, " n"]
    """The editor's instance of each point, 0 for none."""
    world_from_lidar: Float64[ndarray, "4 4"]
    """At the moment itself."""


CastSweep = Callable[[int, float], MomentSweep]
"""Casts the sweep of a time step at its seconds into the drive."""


def name_sweep(step: int) -> str:
    """Name the file of a moment's sweep, relative to the recording."""
    return f"lidar/{step:02d}.npz"


def list_sweep_files(folder: Path, steps: Sequence[int]) -> dict[int, Path]:
    """List the sweeps that are there, by time step."""
    paths = {step: folder / name_sweep(step) for step in sorted(steps)}
    return {step: path for step, path in paths.items() if path.is_file()}


def write_moment_sweep(path: Path, sweep: MomentSweep) -> None:
    """Write a sweep atomically. Raises DataError where it cannot be written."""
    packed = io.BytesIO()
    np.savez_compressed(
        packed,
        points=sweep.points,
        intensity=sweep.intensity,
        times=sweep.times,
        instances=sweep.instances,
        world_from_lidar=sweep.world_from_lidar,
    )
    write_bytes(path, packed.getvalue())


def read_moment_sweep(path: Path) -> MomentSweep:
    """Read what `write_moment_sweep` wrote. Raises DataError where the file is missing or damaged."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            return MomentSweep(
                stored["points"].astype(np.float32),
                stored["intensity"].astype(np.float32),
                stored["times"].astype(np.float64),
                stored["instances"].astype(np.uint32),
                stored["world_from_lidar"].astype(np.float64),
            )
    except Exception as error:  # a damaged archive raises almost anything
        raise DataError(path, f"holds no sweep ({type(error).__name__}: {error})", "Record the drive again") from error
