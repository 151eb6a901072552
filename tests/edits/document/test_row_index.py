import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from instdrive_core.edits.document.row_index import RowIndex

few_keys = hnp.arrays(np.uint32, st.integers(0, 40), elements=st.sampled_from([0, 1, 2, 7, 2**32 - 1]))


@given(few_keys, st.sets(st.sampled_from([0, 1, 2, 5, 7, 2**32 - 1])))
def test_rows_of_keys(keys, wanted):
    index = RowIndex(keys)
    np.testing.assert_array_equal(index.rows(wanted), np.flatnonzero(np.isin(keys, list(wanted))))


@given(few_keys)
def test_groups(keys):
    index = RowIndex(keys)
    expected, counts = np.unique(keys, return_counts=True)
    np.testing.assert_array_equal(index.keys, expected)
    np.testing.assert_array_equal(index.counts, counts)
    np.testing.assert_array_equal(index.keys[index.group_of_row], keys)
