"""Masks of photos written down by hand, as weights of Gaussians in masks."""

import numpy as np
from scipy.sparse import csr_array

from instdrive_core.training.instances.mask_weights import MaskWeights


def observed(rows: int, *photos: list) -> MaskWeights:
    """Photos as lists of masks, masks as lists of Gaussians that show one pixel each (or dicts row → weight)."""
    entries, view_of_mask = [], []
    for number, masks in enumerate(photos):
        for members in masks:
            weights = members if isinstance(members, dict) else dict.fromkeys(members, 1.0)
            entries += [(row, len(view_of_mask), weight) for row, weight in weights.items()]
            view_of_mask.append(number)
    table = np.array(entries, float).reshape(-1, 3)
    places = (table[:, 0].astype(int), table[:, 1].astype(int))
    matrix = csr_array((table[:, 2].astype(np.float32), places), shape=(rows, len(view_of_mask)))
    matrix.sort_indices()
    return MaskWeights(matrix, np.array(view_of_mask, np.int32))
