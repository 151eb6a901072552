"""Weights of all views in one matrix: the same numbers as adding them one by one."""

import numpy as np

from instdrive_core.training.instances.mask_weights import _by_gaussian, _ViewWeights


def test_views_follow_one_another_in_every_row():
    rng = np.random.default_rng(0)
    dense, parts, first = np.zeros((40, 30), np.float32), [], 0
    for masks in (7, 0, 12, 11):
        shown = (rng.random((40, masks)) < 0.3) * rng.random((40, masks), np.float32)
        rows, columns = np.nonzero(shown)
        used, counts = np.unique(rows, return_counts=True)
        values = shown[rows, columns].astype(np.float32)
        rows, counts, columns = (array.astype(np.int32) for array in (used, counts, columns + first))
        parts.append(_ViewWeights(rows, counts, columns, values))
        dense[:, first : first + masks] = shown
        first += masks
    matrix = _by_gaussian(parts, (40, 30))
    assert not parts, "given back on the way"
    np.testing.assert_array_equal(matrix.toarray(), dense)
    assert matrix.has_sorted_indices
    assert matrix.indices.dtype == np.int32
    assert _by_gaussian([], (40, 30)).nnz == 0
