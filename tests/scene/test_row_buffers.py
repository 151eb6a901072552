import numpy as np

from instdrive_core.scene.row_buffers import RowBuffers, allocate_with_spare


def test_what_was_read_with_room_grows_in_place():
    array = allocate_with_spare((80, 3), np.float32)
    array[:] = 1
    longer = RowBuffers().extend("means", array, np.full((4, 3), 2, np.float32))
    assert longer.base is array.base
    assert longer.shape == (84, 3)
    assert longer[79].tolist() + longer[83].tolist() == [1, 1, 1, 2, 2, 2]


def test_only_one_of_two_may_write_behind_the_end():
    array = allocate_with_spare((80,), np.float32)
    first = RowBuffers().extend("a", array, np.ones(4, np.float32))
    second = RowBuffers().extend("a", array, np.zeros(4, np.float32))
    assert second.base is not array.base
    assert first[80:].tolist() == [1, 1, 1, 1]


def test_a_view_of_something_longer_is_not_written_behind():
    whole = np.zeros(100, np.float32)
    longer = RowBuffers().extend("a", whole[:80], np.ones(4, np.float32))
    assert not whole.any()
    assert longer[80:].all()
