"""Which splats of a document's own scene look otherwise, or elsewhere, than the photos show them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool
from numpy import ndarray

from instdrive_core.edits.document.document import Document
from instdrive_core.scene.palette import DRAWN
from instdrive_core.scene.selection import Flag


def find_edited_rows(document: Document, count: int) -> Bool[ndarray, " n"]:
    """Find which of the first `count` rows were deleted, moved or recoloured, or drive another way.

    Turning the whole scene moves nothing against anything else, and does not count.
    """
    scene, transforms, colors = document.scene, document.transforms, document.colors
    moved = (transforms.matrices != transforms.homes).any(axis=(1, 2))
    recolored = (colors.values[:, :DRAWN] != colors.values[0, :DRAWN]).any(axis=1)
    other_way = np.zeros(len(scene.actors) + 1, bool)
    for node, track in enumerate(scene.actors, start=1):
        first = document.get_first_track(node)
        same = track.times.shape == first.times.shape and np.array_equal(track.world_from_box, first.world_from_box)
        other_way[node] = not same
    edited = (document.state.flags & Flag.DELETED) != 0
    edited = edited | moved[transforms.indices] | recolored[colors.indices] | other_way[scene.nodes]
    return edited[:count]
