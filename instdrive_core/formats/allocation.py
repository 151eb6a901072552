"""Memory for the splats of a scene that is opened: compared with what is free before any is taken."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from instdrive_core.available_memory import measure_available_memory
from instdrive_core.errors import SceneTooLargeError
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.row_buffers import allocate_with_spare

MEMORY_TO_READ = 1.1
"""Memory to open and look at a scene, as a multiple of its arrays, without `BESIDE_BYTES`."""
MEMORY_TO_EDIT = 4.0
"""Memory to edit and export a scene, as a multiple of its arrays. Measured: 3.96 for recolouring all of a scene of a
million splats, moving some, and exporting it."""
BESIDE_BYTES = 75
"""Bytes per splat for what is computed while a scene is looked at. Measured with a million splats, opening and linting
take 333 bytes each of SH degree 3 (arrays: 246) and 142 without SH (66)."""
_FLOATS, _ID_BYTES = 14, 10
"""Floats of a splat without SH (mean, quaternion, scales, opacity, colour), and bytes of its instance ID, codeword and
node."""


@dataclass(frozen=True)
class ReadOptions:
    """Which splats of a scene are read, and how much memory must be free for them."""

    keep_every: int = 1
    """Read every k-th row (0, k, 2k …), and take memory for these only."""
    memory_factor: float = MEMORY_TO_READ
    """Memory that must be free, as a multiple of the arrays."""
    time: float | None = None
    """Seconds into the drive at which things that bend get their shape; None takes the middle of each one's track."""
    data: Path | None = None
    """Folder of the data set that the scene was trained on, for tracks that its file does not hold."""

    def count_kept(self, count: int) -> int:
        """Count the rows that are read of `count`."""
        return -(-count // self.keep_every)

    def locate_rows(self, start: int, stop: int) -> tuple[slice, slice]:
        """Find which of the file's rows from `start` to `stop` are kept, and which rows of the scene they become."""
        first = -start % self.keep_every
        return slice(first, None, self.keep_every), slice(self.count_kept(start), self.count_kept(stop))


WHOLE = ReadOptions()


def allocate_gaussians(
    path: str | Path,
    count: int,
    rest: int,
    features: int = 0,
    options: ReadOptions = WHOLE,
    *,
    extra: int = 0,
    passing: int = 0,
) -> Gaussians:
    """Allocate Gaussians to be filled, one for each row that is kept; edits can append to them without a copy.

    Args:
        path: the file, for messages.
        count: rows in the file.
        rest: SH coefficients above the constant.
        features: dimension of the features.
        options: which rows are kept.
        extra: bytes per row of further columns.
        passing: bytes per row of the file that are needed while it is read, whichever rows are kept.

    Raises SceneTooLargeError where there is not enough memory; none was taken then.
    """
    check_memory(path, count, count_row_bytes(rest, features) + extra, options, passing * count)
    shapes = [(3,), (4,), (3,), (), (3,), (rest, 3), (features,)]
    return Gaussians(*(allocate_with_spare((options.count_kept(count), *shape), np.float32) for shape in shapes))


def count_row_bytes(rest: int, features: int) -> int:
    """Count the bytes that a splat takes in an opened scene, given its SH coefficients and feature dimension."""
    return 4 * (_FLOATS + 3 * rest + features) + _ID_BYTES


def check_memory(path: str | Path, count: int, size: int, options: ReadOptions = WHOLE, passing: float = 0.0) -> None:
    """Check that rows fit into memory. Raises SceneTooLargeError where they do not.

    Args:
        path: the file, for messages.
        count: rows in the file.
        size: bytes of a row that is kept.
        options: which rows are kept.
        passing: bytes in all that are needed while the file is read, whichever rows are kept.
    """
    row = options.memory_factor * size + BESIDE_BYTES
    needed = row * options.count_kept(count) + passing
    available = measure_available_memory()
    if needed <= available:
        return
    fitting = math.floor((available - passing) / row)
    keep_every = math.ceil(count / fitting) if fitting > 0 else None
    raise SceneTooLargeError(path, count, row * count + passing, available, keep_every)


def enlarge_splats(log_scales: Float32[ndarray, "n 3"], keep_every: int) -> None:
    """Make splats larger, in place, so that every k-th one covers what all of them did.

    The two longer axes grow by √k each, so that the face of a splat that lies in a surface grows by k; the shortest
    one, across the surface, stays.
    """
    shortest = np.argmin(log_scales, axis=1)[:, None]
    kept = np.take_along_axis(log_scales, shortest, axis=1)
    log_scales += np.float32(0.5 * math.log(keep_every))
    np.put_along_axis(log_scales, shortest, kept, axis=1)
