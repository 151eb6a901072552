"""Instance colours that colour-blind eyes tell apart. They are only shown: IDs keep their colours everywhere else."""

from __future__ import annotations

import numpy as np
from jaxtyping import UInt8, UInt32
from numpy import ndarray

from instdrive_core.instances.colormap import ID_LIMIT, MULTIPLIER

SAFE_COLORS: UInt8[ndarray, "12 3"] = np.array(
    [
        (153, 102, 255),
        (255, 0, 0),
        (102, 255, 255),
        (153, 0, 102),
        (255, 255, 0),
        (102, 153, 204),
        (204, 153, 153),
        (204, 255, 204),
        (102, 51, 153),
        (153, 0, 0),
        (102, 0, 255),
        (255, 153, 102),
    ],
    np.uint8,
)
"""RGB8. The twelve of the web-safe colours whose least difference is greatest, over eyes with all three cones and
eyes that lack one (after Machado, Oliveira and Fernandes 2009)."""
_HIGH_BITS = 12


def paint_safe_colors(ids: UInt32[ndarray, "*n"]) -> UInt8[ndarray, "*n 3"]:
    """Choose the safe colour (RGB8) of each ID; IDs that follow each other get different ones, 0 (none) is black.

    Of IDs above 24 bits the low 24 count, as in the colour map.
    """
    places = ids.astype(np.uint64) * np.uint64(MULTIPLIER) % np.uint64(ID_LIMIT)
    high = places >> np.uint64(24 - _HIGH_BITS)
    found = SAFE_COLORS[(high * np.uint64(len(SAFE_COLORS)) >> np.uint64(_HIGH_BITS)).astype(np.int64)]
    found[places == 0] = 0
    return found
