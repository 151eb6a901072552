"""One thing out of the masks that several layers of overlapping masks have of it."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from jaxtyping import Bool
from numpy import ndarray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

ShownThing = dict[int, Bool[ndarray, "_ _"]]
"""Pixels of a thing by photo."""
_COVERED = 0.5
"""Share of the smaller mask that two masks of one thing have in common."""


def join_overlapping(things: list[ShownThing]) -> list[ShownThing]:
    """Join the things of one camera that cover each other in most of the photos that show both."""
    pairs = [pair for pair in combinations(range(len(things)), 2) if _are_one(things[pair[0]], things[pair[1]])]
    rows, columns = ([pair[end] for pair in pairs] for end in (0, 1))
    graph = coo_array((np.ones(len(pairs)), (rows, columns)), shape=(len(things), len(things)))
    if not things:
        return []
    count, numbers = connected_components(graph, directed=False)
    return [_unite([things[k] for k in np.flatnonzero(numbers == number)]) for number in range(count)]


def _are_one(one: ShownThing, other: ShownThing) -> bool:
    shared = one.keys() & other.keys()
    covered = [
        bool((one[photo] & other[photo]).sum() > _COVERED * min(one[photo].sum(), other[photo].sum()))
        for photo in shared
    ]
    return 2 * sum(covered) > len(shared)


def _unite(things: list[ShownThing]) -> ShownThing:
    photos = sorted({photo for thing in things for photo in thing})
    return {photo: np.any([thing[photo] for thing in things if photo in thing], axis=0) for photo in photos}
