"""Colours of splats kept from one sharp frame to the next, for as long as they are seen from the same place."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray

from instdrive_app.render.software.placed_splats import PlacedSplats

_UNKNOWN = np.float32(-1)


class ColorMemory:
    """RGB of splats as seen from one place: turning the camera there, or hiding and deleting, changes none of them.

    Only the render thread uses it.
    """

    def __init__(self) -> None:
        self._colors = np.zeros((0, 3), np.float32)
        self._place: tuple[object, ...] = ()
        self._table: Float64[ndarray, "f 18"] = np.zeros((0, 18))

    def recall(self, placed: PlacedSplats, position: Float64[ndarray, "3"]) -> Float32[ndarray, "n 3"]:
        """Take the colours known of all splats from a place in the world, -1 where none are; what is found out may be
        written there. Empty where splats look alike from everywhere."""
        state = placed.state
        if not state.gaussians.sh_rest.shape[1]:
            return np.zeros((0, 3), np.float32)
        arrays = (placed, state.nodes, state.move_entries, state.color_entries, state.color_values)
        same = len(self._place) == len(arrays) + 1 and all(
            kept is array for kept, array in zip(self._place, arrays, strict=False)
        )
        if not same or self._place[-1] != position.tobytes() or not np.array_equal(self._table, placed.frame_table):
            if len(self._colors) != len(placed.means):
                self._colors = np.empty((len(placed.means), 3), np.float32)
            self._colors.fill(_UNKNOWN)
            self._place, self._table = (*arrays, position.tobytes()), placed.frame_table
        return self._colors
