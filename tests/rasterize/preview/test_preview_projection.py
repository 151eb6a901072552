"""Sixteen rows at a time are projected as one by one, at every end of an array and among what is no number."""

from __future__ import annotations

import numpy as np
import pytest
from little_scenes import random_splats, small_camera

from instdrive_core.maths.workspace import Workspace
from instdrive_core.rasterize.kernels.bin import TILE, bin_splats
from instdrive_core.rasterize.kernels.fragment import EIGHTH
from instdrive_core.rasterize.kernels.project import DEPTH, MEAN_X, OPACITY, POWER_LIMIT, project
from instdrive_core.rasterize.kernels.settings import RasterSettings
from instdrive_core.rasterize.preview.colors import know_colors
from instdrive_core.rasterize.preview.projection import project_splats
from instdrive_core.rasterize.preview.splats import (
    AT_C,
    AT_COV_XX,
    AT_COV_XY,
    AT_INSTANCE,
    AT_LIMIT,
    AT_OPACITY,
    AT_ROW,
    AT_VALUES,
    AT_X,
    AT_Y,
)
from instdrive_core.rasterize.preview.tile_order import KEY
from instdrive_core.rasterize.preview.tiles import bin_preview_splats


def _spoil(arrays):
    """Make some rows what nobody can draw."""
    means, quats, log_scales, opacities = arrays
    means[3::40, 1], quats[5::40], log_scales[7::40, 2] = np.nan, 0, np.nan
    log_scales[9::40, 0], opacities[11::40], means[13::40] = np.inf, np.nan, np.inf
    log_scales[15::40] = -np.inf  # a point, which the low-pass makes visible


@pytest.mark.parametrize("antialiased", [False, True])
@pytest.mark.parametrize("count", [1, 15, 16, 17, 700])
def test_lines_hold_what_is_projected_one_by_one(count, antialiased):
    camera, settings = small_camera(90, 70), RasterSettings(antialiased=antialiased)
    splats = random_splats(camera, count, 3, seed=count)
    *arrays, colors = (np.array(array, np.float32) for array in splats.arrays())
    _spoil(arrays)
    instances = np.arange(count, dtype=np.uint32)[::-1] + np.uint32(7)
    found = project_splats(*arrays, camera, settings, know_colors(colors), Workspace(), instances=instances)
    plain = project(*arrays, camera, settings)
    seen = np.flatnonzero(found.depths)
    assert set(seen) <= set(plain.rows)
    for row in set(plain.rows) - set(seen):  # those that hold no pixel centre
        mean, (xx, _, yy) = plain.splats[plain.places[row], MEAN_X : MEAN_X + 2], plain.covariances[plain.places[row]]
        reach = np.sqrt(plain.splats[plain.places[row], POWER_LIMIT] * np.array([xx, yy]))
        low, high = np.maximum(np.ceil(mean - reach - 0.5), 0), np.floor(mean + reach - 0.5)
        assert (low > np.minimum(high, [camera.width - 1, camera.height - 1])).any()
    lines, expected = found.lines[seen], plain.splats[plain.places[seen]]
    np.testing.assert_array_equal(lines[:, int(AT_ROW)].view(np.int32), seen)
    np.testing.assert_array_equal(lines[:, int(AT_INSTANCE)], instances[seen])
    near = {"rtol": 2e-5, "atol": 2e-4}  # pixels, beyond the edge of the picture, too
    np.testing.assert_allclose(lines[:, [int(AT_X), int(AT_Y)]] + 0.5, expected[:, MEAN_X : MEAN_X + 2], **near)
    np.testing.assert_allclose(lines[:, int(AT_VALUES)], expected[:, DEPTH], rtol=1e-6)
    np.testing.assert_array_equal(found.depths[seen], lines[:, int(AT_VALUES)])
    np.testing.assert_allclose(lines[:, int(AT_OPACITY)], expected[:, OPACITY], rtol=2e-5)
    np.testing.assert_allclose(lines[:, int(AT_LIMIT)], expected[:, POWER_LIMIT], rtol=1e-4, atol=1e-4)
    covariances = plain.covariances[plain.places[seen]]
    np.testing.assert_allclose(lines[:, [int(AT_COV_XX), int(AT_COV_XY)]], covariances[:, :2], rtol=1e-4, atol=1e-3)
    heights = 0.5 * EIGHTH / lines[:, int(AT_C)] ** 2  # what tiles take for the third
    np.testing.assert_allclose(heights, covariances[:, 2], rtol=1e-4, atol=1e-3)
    np.testing.assert_array_equal(found.colors[seen], colors[seen])


def _draws(line, tile_row, tile_column, camera, min_alpha):
    """Whether a splat has a visible fragment in a tile, within the picture."""
    y, x = np.mgrid[:TILE, :TILE] + np.array([tile_row, tile_column])[:, None, None] * TILE
    a, b, mean_x, c, mean_y, base = line[:6]
    dx, dy = x - mean_x, y - mean_y
    visible = base - (a * dx + b * dy) ** 2 - (c * dy) ** 2 >= np.log2(min_alpha) / 8
    return bool((visible & (x < camera.width) & (y < camera.height)).any())


@pytest.mark.parametrize("scale", [0.0, -2.0, 1.5])
def test_tiles_list_all_that_reach_them_and_hardly_more(scale):
    """Small splats of one to four tiles, and large ones of many."""
    camera, settings = small_camera(200, 150), RasterSettings()
    splats = random_splats(camera, 3000, 3, seed=4)
    *arrays, colors = (np.array(array, np.float32) for array in splats.arrays())
    arrays[2] += np.float32(scale)
    workspace = Workspace()
    found = project_splats(*arrays, camera, settings, know_colors(colors), workspace)
    tiles = bin_preview_splats(found, camera.width, camera.height, workspace)
    rows = (tiles.entries & ((np.uint64(1) << KEY) - np.uint64(1))).astype(int)
    listed = set(zip(np.repeat(np.arange(len(tiles.starts) - 1), np.diff(tiles.starts)), rows, strict=True))
    assert len(listed) == len(rows), "no pair twice"
    plain = project(*arrays, camera, settings)
    lists = bin_splats(plain, camera.width, camera.height)
    needed = (lists.spans[:, 1] > lists.spans[:, 0]).nonzero()[0]
    of_tile = np.repeat(np.arange(len(lists.starts) - 1), np.diff(lists.starts))
    needed = set(zip(of_tile[needed], plain.rows[lists.splats[needed]], strict=True))
    assert len(needed - listed) < 0.005 * len(needed), "only where an ellipse touches a tile between pixel centres"
    for tile, row in needed - listed:
        assert not _draws(found.lines[row].astype(float), *divmod(int(tile), tiles.columns), camera, settings.min_alpha)
    assert len(listed - needed) < 0.03 * len(needed)
    assert len(needed) > 2000
