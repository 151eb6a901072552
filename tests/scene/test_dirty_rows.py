"""The log of touched rows, against sets of rows."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from instdrive_core.scene.dirty_rows import DirtyRows

COUNT = 40
ranges = st.tuples(st.integers(0, COUNT - 1), st.integers(1, 9)).map(lambda r: (r[0], min(r[0] + r[1], COUNT)))
steps = st.lists(
    st.one_of(
        st.tuples(st.just("touch"), ranges),
        st.tuples(st.just("take"), st.integers(0, 2)),
    ),
    max_size=200,
)


@given(steps)
def test_every_reader_is_told_of_all_rows_touched_since_it_last_asked(script):
    log = DirtyRows(COUNT)
    readers, untold = [log.create_reader() for _ in range(3)], [set(range(COUNT)) for _ in range(3)]
    for what, value in script:
        if what == "touch":
            log.touch(*value)
            untold = [rows | set(range(*value)) for rows in untold]
            continue
        told = readers[value].take()
        assert untold[value] <= set(range(*told or (0, 0)))
        untold[value] = set()
        assert readers[value].take() is None


def test_a_reader_that_keeps_up_is_told_the_range_and_no_more():
    log = DirtyRows(COUNT)
    reader = log.create_reader()
    assert reader.take() == (0, COUNT)
    for start in range(300):
        log.touch(start % 30, start % 30 + 2)
        assert reader.take() == (start % 30, start % 30 + 2)
    log.touch(3, 5)
    log.touch(20, 21)
    assert reader.take() == (3, 21)


def test_readers_do_not_take_from_each_other():
    log = DirtyRows(COUNT)
    first, second = log.create_reader(), log.create_reader()
    assert first.take() == second.take() == (0, COUNT)
    log.touch(1, 2)
    assert first.take() == (1, 2)
    assert second.take() == (1, 2)


@pytest.mark.parametrize(("touched", "left"), [((30, 40), None), ((10, 40), (10, 20)), ((5, 6), (5, 6))])
def test_rows_that_are_gone_are_forgotten(touched, left):
    log = DirtyRows(COUNT)
    reader = log.create_reader()
    reader.take()
    log.touch(*touched)
    log.shorten(20)
    assert reader.take() == left


def test_no_rows_are_never_dirty():
    assert DirtyRows(0).create_reader().take() is None
