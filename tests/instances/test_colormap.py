import numpy as np
import pytest

from instdrive_core.instances.colormap import ID_LIMIT, colors_from_ids, ids_from_colors


def test_every_id_has_its_own_color_and_comes_back():
    ids = np.arange(ID_LIMIT, dtype=np.uint32)
    seen = np.zeros(ID_LIMIT, bool)
    for part in np.split(ids, 16):
        colors = colors_from_ids(part)
        np.testing.assert_array_equal(ids_from_colors(colors), part)
        seen[colors.astype(np.uint32) @ np.array([65536, 256, 1], np.uint32)] = True
    assert seen.all()


def test_none_is_black_and_small_ids_are_far_apart():
    colors = colors_from_ids(np.arange(65, dtype=np.uint32)).astype(int)
    assert not colors[0].any()
    distances = np.linalg.norm(colors[:, None] - colors[None], axis=-1)
    assert distances[~np.eye(65, dtype=bool)].min() > 15


def test_larger_ids_are_refused():
    with pytest.raises(ValueError, match=str(ID_LIMIT)):
        colors_from_ids(np.array([ID_LIMIT], np.uint32))
