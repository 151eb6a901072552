"""Weights of all views in one matrix: the same numbers as adding them one by one."""

import numpy as np
import pytest

from instdrive_core.training.instances.weight_spool import ViewWeights, WeightSpool


@pytest.mark.parametrize("in_memory", [1 << 20, 1])
def test_views_follow_one_another_in_every_row(in_memory):
    """Whether they waited in memory or in a file."""
    rng = np.random.default_rng(0)
    dense, parts, first = np.zeros((40, 30), np.float32), [], 0
    for masks in (7, 0, 12, 11):
        shown = (rng.random((40, masks)) < 0.3) * rng.random((40, masks), np.float32)
        rows, columns = np.nonzero(shown)
        used, counts = np.unique(rows, return_counts=True)
        values = shown[rows, columns].astype(np.float32)
        rows, counts, columns = (array.astype(np.int32) for array in (used, counts, columns + first))
        parts.append(ViewWeights(rows, counts, columns, values))
        dense[:, first : first + masks] = shown
        first += masks
    with WeightSpool(40, in_memory) as spool:
        for part in parts:
            spool.add(part)
        assert (getattr(spool._file, "_rolled", None) is True) == (in_memory == 1)
        matrix = spool.build_matrix(30)
    np.testing.assert_array_equal(matrix.toarray(), dense)
    assert matrix.has_sorted_indices
    assert matrix.indices.dtype == np.int32
    with WeightSpool(40) as spool:
        assert spool.build_matrix(30).nnz == 0
