"""Which splats of a moving object are its shadow on the ground, and what the table says of them."""

import numpy as np

from instdrive_core.instances.shadows import (
    LEARNED_SHADOW,
    SYNTHETIC,
    find_learned_shadows,
    find_marked_shadows,
    mark_learned_shadows,
)
from instdrive_core.instances.table import build_instance_table
from instdrive_core.maths.spherical_harmonics import dc_from_color

BOX = np.array([[1.8, 4.5, 1.5]])
FOOT = -BOX[0, 2] / 2


def find(mean=(1.1, 0.0, FOOT + 0.05), sizes=(0.2, 0.2, 0.01), quat=(1.0, 0, 0, 0), color=0.05, node=1):
    arrays = [np.array([value], np.float32) for value in (mean, quat, np.log(sizes), [[color] * 3][0])]
    means, quats, log_scales, colors = arrays
    dc = dc_from_color(colors).astype(np.float32)
    found = find_learned_shadows(means, quats, log_scales, dc, np.array([node], np.uint16), BOX)
    return bool(found[0])


def test_it_lies_dark_and_flat_at_the_foot_of_what_moves():
    assert find()
    assert not find(node=0)  # the road
    assert not find(mean=(0, 0, 0.7))  # the roof
    assert not find(color=0.6)
    assert not find(sizes=(0.2, 0.2, 0.2))
    beside = (1.3, 0.0, FOOT + 0.05)
    assert find(mean=beside, sizes=(0.2, 0.2, 0.2))
    assert not find(mean=beside, sizes=(0.5, 0.5, 0.5))
    assert not find(mean=beside, sizes=(0.2, 0.2, 0.2), color=0.6)
    assert not find(sizes=(0.02, 0.02, 0.01))
    upright = (np.sqrt(0.5), np.sqrt(0.5), 0, 0)
    assert not find(quat=upright)  # a sill
    assert find(quat=upright, sizes=(0.2, 0.01, 0.2))


def test_the_column_tells_it_and_scenes_without_any_have_none():
    marked = mark_learned_shadows(np.array([False, True]))
    assert marked[SYNTHETIC].tolist() == [0, LEARNED_SHADOW]
    np.testing.assert_array_equal(find_marked_shadows(marked), [False, True])
    assert mark_learned_shadows(np.zeros(2, bool)) == {}
    assert find_marked_shadows({}) is None


def test_it_lies_outside_of_the_bounds_but_counts():
    rng = np.random.default_rng(0)
    body, shadow = rng.uniform(-1, 1, (100, 3)), rng.uniform(-4, 4, (100, 3)) * [1, 1, 0]
    means, ids = np.concatenate([body, shadow]), np.full(200, 7, np.uint32)
    is_shadow = np.arange(200) >= 100
    entry = build_instance_table(ids, means, shadows=is_shadow)[7]
    assert entry.count == 200
    assert np.abs(entry.bounds).max() <= 1
    assert entry.bounds == build_instance_table(ids[:100], body)[7].bounds
    # What is nothing else has the bounds of its shadow.
    assert build_instance_table(ids[100:], shadow, shadows=is_shadow[100:])[7].bounds != ((0, 0, 0), (0, 0, 0))
