import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from instdrive_core.scene.named_entries import find_named_entries

entries = hnp.arrays(np.uint16, 12, elements=st.integers(0, 3))
rows = hnp.arrays(np.int64, st.integers(0, 20), elements=st.integers(0, 11))


@given(entries, rows, st.lists(st.integers(0, 20), max_size=4))
def test_pairs_come_by_part_then_by_entry(indices, asked, cuts):
    bounds = np.array([0, *sorted(min(cut, len(asked)) for cut in cuts), len(asked)])
    found = find_named_entries(indices, asked, bounds, 4)
    owner = np.repeat(np.arange(len(bounds) - 1), np.diff(bounds))
    pairs, place = np.unique(np.stack([owner, indices[asked]], axis=1), axis=0, return_inverse=True)
    np.testing.assert_array_equal(np.stack([found.parts, found.entries], axis=1), pairs.reshape(-1, 2))
    np.testing.assert_array_equal(found.place, place.reshape(-1))
