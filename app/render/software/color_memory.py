"""Colours of splats kept from one sharp frame to the next, for as long as they are seen from the same place."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_app.render.software.placed_splats import PlacedSplats
from instdrive_core.rasterize.preview.colors import RememberedColors


class ColorMemory:
    """RGB of splats as seen from one place: turning the camera there, or hiding and deleting, changes none of them.

    Only the render thread uses it.
    """

    def __init__(self) -> None:
        self._colors = RememberedColors(0)
        self._place: tuple[object, ...] = ()
        self._table: Float64[ndarray, "f 18"] = np.zeros((0, 18))

    def recall(self, placed: PlacedSplats, position: Float64[ndarray, "3"]) -> RememberedColors:
        """Take the colours known of all splats from a place in the world; what is found out may be written there.

        Of none where splats look alike from everywhere.
        """
        state = placed.state
        if not state.gaussians.sh_rest.shape[1]:
            self._place, self._colors = (), RememberedColors(0)  # what another scene's took is free again
            return self._colors
        position = position + 0.0  # -0 is no other place than 0
        place = (placed, state.nodes, state.move_entries, state.color_entries, state.color_values, position.tobytes())
        same = len(place) == len(self._place) and all(a is b for a, b in zip(place[:-1], self._place, strict=False))
        if not same or place[-1] != self._place[-1] or not np.array_equal(self._table, placed.frame_table):
            if len(self._colors.colors) != len(placed.means):
                self._colors = RememberedColors(len(placed.means))
            self._colors.forget()
            self._place, self._table = place, placed.frame_table
        return self._colors
