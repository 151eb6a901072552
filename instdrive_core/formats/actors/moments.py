"""The moment of a track in which an object's shape and colours are taken."""

from __future__ import annotations

import numpy as np

from instdrive_core.scene.track import Track


def find_shown_row(track: Track, time: float | None) -> int:
    """Find the row of a track nearest to a time (s); the middle one if that is None."""
    return len(track.times) // 2 if time is None else int(np.abs(track.times - time).argmin())
