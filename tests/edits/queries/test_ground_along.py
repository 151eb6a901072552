"""Ground below places, one by one and along a way."""

import numpy as np
from parked_street import CAR, parked_street

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.placement import find_ground_along, find_ground_below
from instdrive_core.errors import EditError


def test_ground_along_a_way_is_the_ground_below_each_place():
    document = Document(parked_street().scene)
    rng = np.random.default_rng(0)
    low, high = (function(document.scene.gaussians.means, axis=0) for function in (np.min, np.max))
    places = np.vstack([rng.uniform(low - 15, high + 15, (60, 3)), [[1e6, 0, 0]]])
    heights = find_ground_along(document, (CAR,), places)
    for place, height in zip(places, heights, strict=True):
        try:
            assert find_ground_below(document, (CAR,), place) == height
        except EditError:
            assert np.isnan(height)
    assert 10 < np.count_nonzero(np.isnan(heights)) < 55
    assert find_ground_along(document, (CAR,), places[:0]).shape == (0,)
