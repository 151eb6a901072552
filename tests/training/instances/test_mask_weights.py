"""Weights of all views in one matrix: the same numbers as adding them one by one."""

import numpy as np
import pytest
from scipy.sparse import csr_array

from instdrive_core.training.instances.mask_weights import MaskWeights
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


def test_what_is_silenced_has_no_weight_and_the_others_keep_theirs():
    weights = csr_array(np.array([[1, 0, 2], [0, 3, 0], [4, 0, 0]], np.float32))
    observed = MaskWeights(weights, np.array([0, 0, 1], np.int32), unmasked=np.array([5, 6, 7], np.float32))
    silent = observed.silence(np.array([True, False, False]))
    assert silent.sum_weights().tolist() == [0, 3, 4]
    assert silent.unmasked is not None
    assert silent.unmasked.tolist() == [0, 6, 7]
    assert observed.sum_weights().tolist() == [3, 3, 4]
