"""Which of many points lies nearest to each of a few places."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int64
from numpy import ndarray
from scipy.spatial import KDTree


def find_nearest_rows(points: Float[ndarray, "n d"], places: Float[ndarray, "m d"]) -> Int64[ndarray, " m"]:
    """Find the row of the point nearest to each place. The tree is built quickly, as it is asked little."""
    return np.asarray(KDTree(points, balanced_tree=False, compact_nodes=False).query(places)[1])
