import numpy as np
import pytest

from instdrive_core.scene.selection import Flag, SplatState


@pytest.fixture
def state():
    return SplatState(10)


def test_only_rows_that_really_change_are_returned(state):
    assert state.change(np.array([1, 4, 5]), Flag.SELECTED, True).tolist() == [1, 4, 5]
    assert state.change(np.array([4, 6]), Flag.SELECTED, True).tolist() == [6]
    assert state.change(np.array([0, 1]), Flag.SELECTED, False).tolist() == [1]
    assert state.find_rows(Flag.SELECTED).tolist() == [4, 5, 6]


def test_bits_are_independent(state):
    for flag in Flag:
        state.change(np.array([3]), flag, True)
    state.change(np.array([3]), Flag.LOCKED, False)
    assert state.flags[3] == Flag.SELECTED | Flag.HIDDEN | Flag.DELETED
    assert not state.drawn[3]
    assert state.find_mask(Flag.LOCKED | Flag.DELETED).sum() == 1
    state.change(np.array([3]), Flag.HIDDEN | Flag.DELETED, False)
    assert state.drawn.all()


def test_dirty_range_and_version_follow_changes(state):
    version, reader = state.version, state.create_dirty_reader()
    reader.take()
    state.change(np.array([2]), Flag.HIDDEN, False)
    assert state.version == version
    assert reader.take() is None
    state.change(np.array([7, 2]), Flag.HIDDEN, True)
    state.change(np.array([5]), Flag.HIDDEN, True)
    assert state.version > version
    assert reader.take() == (2, 8)
    assert reader.take() is None


def test_growing_appends_clean_rows(state):
    state.change(np.array([9]), Flag.DELETED, True)
    reader = state.create_dirty_reader()
    reader.take()
    state.append(3)
    assert len(state) == 13
    assert state.flags.tolist() == [0] * 9 + [8, 0, 0, 0]
    assert reader.take() == (10, 13)


def test_flags_cannot_be_written_from_outside(state):
    with pytest.raises(ValueError, match="read-only"):
        state.flags[0] = 1


def test_what_is_shared_never_changes_and_costs_nothing_until_it_would(state):
    state.change(np.array([1]), Flag.HIDDEN, True)
    shared, fork = state.share_rows(), state.fork()
    assert np.shares_memory(shared, state.flags)
    assert np.shares_memory(fork.flags, state.flags)
    reader = fork.create_dirty_reader()
    state.change(np.array([4]), Flag.DELETED, True)
    fork.change(np.array([5]), Flag.LOCKED, True)
    assert shared.tolist() == [0, 2, 0, 0, 0, 0, 0, 0, 0, 0]
    assert state.flags.tolist() == [0, 2, 0, 0, 8, 0, 0, 0, 0, 0]
    assert fork.flags.tolist() == [0, 2, 0, 0, 0, 4, 0, 0, 0, 0]
    assert reader.take() == (0, 10)
    flags = state.flags
    state.change(np.array([4]), Flag.DELETED, False)
    assert flags[4] == 0, "written in place where nobody else reads"
