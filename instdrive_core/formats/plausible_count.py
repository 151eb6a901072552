"""The most splats that a compressed file can be believed to hold, checked before memory is taken for them."""

from __future__ import annotations

from pathlib import Path

from instdrive_core.errors import DataError

SMALL_COUNT = 400_000
"""Always believed: about 100 MB once opened, at SH degree 3."""
BYTES_PER_SPLAT = 4
"""Real scenes need 12 or more even after compression; a bomb of equal splats needs almost none."""


def check_plausible_count(path: str | Path, count: int, size: int) -> None:
    """Check that `size` compressed bytes can be `count` splats of a scene. Raises DataError where they cannot."""
    most = SMALL_COUNT + size // BYTES_PER_SPLAT
    if count > most:
        problem = f"{count} splats in {size} bytes is more than a scene of that size can hold ({most})"
        raise DataError(path, problem, "The file's count is wrong, or it holds copies of few splats; use a .ply")
