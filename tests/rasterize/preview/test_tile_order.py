"""The order within a tile equals a stable sort by depth, however depths lie."""

from __future__ import annotations

import numba
import numpy as np
import pytest

from instdrive_core.rasterize.preview.tile_order import KEY, new_counters, order_tile


@numba.njit
def _order(entries, start, splats):
    count = np.uint64(len(entries)) - start
    order_tile(entries, start, start + count, new_counters(), np.empty(2 * count, np.uint64), splats, np.uint64(3))


def _spread(rng, count):
    return rng.gamma(2, 10, count) + 0.1


def _piled_up(rng, count):
    """Nearly all within less than two digits tell apart, and one far away: what places one by one gives up on."""
    depths = 10 + 1e-4 * rng.random(count)
    depths[0] = 1e6
    return depths


def _alike(rng, count):
    return np.where(rng.random(count) < 0.5, 2.5, 7.0)


@pytest.mark.parametrize("count", [0, 1, 2, 32, 33, 500, 20_000])
@pytest.mark.parametrize("depths", [_spread, _piled_up, _alike])
def test_nearest_first_and_equal_depths_in_rising_order(depths, count):
    rng = np.random.default_rng(count)
    depths = depths(rng, count).astype(np.float32) if count else np.zeros(0, np.float32)
    rows = np.sort(rng.choice(10**6, count, replace=False))
    entries = (depths.view(np.uint32).astype(np.uint64) << KEY) | rows.astype(np.uint64)
    before = np.array([5, 9], np.uint64)  # another tile's
    splats = np.full(count + 5, -1, np.int32)
    _order(np.concatenate([before, entries]), np.uint64(2), splats)
    np.testing.assert_array_equal(splats[3 : 3 + count], rows[np.argsort(depths, kind="stable")])
    assert (np.delete(splats, np.arange(3, 3 + count)) == -1).all()
