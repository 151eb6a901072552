"""Tile lists: every pair that was counted is placed once, and bounds that are no numbers make no pair."""

import numpy as np
import pytest

from instdrive_core.rasterize.kernels.bin import TILE, bin_splats
from instdrive_core.rasterize.kernels.project import Projection, project
from instdrive_core.rasterize.kernels.settings import DEFAULT_SETTINGS
from instdrive_core.scene.camera import Camera, look_at

WIDTH, HEIGHT = 203, 118


def street(seed: int, count: int = 60_000) -> Projection:
    """Splats of all sizes and shapes, many of them needles."""
    rng = np.random.default_rng(seed)
    means = rng.uniform([-40, 2, -5], [40, 80, 15], (count, 3)).astype(np.float32)
    quats, log_scales = rng.normal(size=(count, 4)), rng.normal(-2.5, 1.5, (count, 3))
    opacities = rng.uniform(0.01, 1, count)
    camera = Camera(200.0, 200.0, 101.0, 59.0, WIDTH, HEIGHT, look_at(np.zeros(3), np.array([0, 10.0, 0])))
    arrays = (array.astype(np.float32) for array in (means, quats, log_scales, opacities))
    return project(*arrays, camera, DEFAULT_SETTINGS)


@pytest.mark.parametrize("seed", range(4))
def test_every_counted_pair_is_placed_once(seed):
    projection = street(seed)
    tiles = bin_splats(projection, WIDTH, HEIGHT)
    owners = np.repeat(np.arange(len(projection.rows)), np.diff(tiles.splat_starts))
    np.testing.assert_array_equal(np.sort(tiles.entries), np.arange(len(tiles.entries)))
    np.testing.assert_array_equal(tiles.splats, owners[tiles.entries])
    for tile in range(len(tiles.starts) - 1):
        within = tiles.splats[tiles.starts[tile] : tiles.starts[tile + 1]]
        assert np.all(np.diff(within) > 0), "nearest first, none twice"
    assert np.all(tiles.spans[:, 0] <= tiles.spans[:, 1])
    assert tiles.spans.max() <= TILE


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 3e38, -3e38])
@pytest.mark.parametrize("column", range(3))
def test_covariances_and_means_beyond_all_bounds_stay_within_the_lists(value, column):
    projection = street(0, 2_000)
    projection.covariances[7, column] = value
    projection.splats[9, min(column, 1)] = value
    tiles = bin_splats(projection, WIDTH, HEIGHT)
    np.testing.assert_array_equal(np.sort(tiles.entries), np.arange(len(tiles.entries)))
    assert 0 <= tiles.splats.min() <= tiles.splats.max() < len(projection.rows)


def test_a_bound_on_the_edge_of_a_pixel_is_counted_as_it_is_placed():
    """A needle met in training: with fastmath one kernel counted six tiles and the other placed it in five."""
    mean, conic = (
        (105.37431335449219, 229.7801513671875),
        (0.37837690114974976, -0.06294608116149902, 0.024751799181103706),
    )
    splat = [[*mean, *conic, 0.9992861151695251, 5.517228126525879, 11.081098556518555]]
    covariance = [[4.580868721008301, 11.649567604064941, 70.02703094482422]]
    arrays = (np.array(values, np.float32) for values in (splat, covariance))
    tiles = bin_splats(Projection(np.zeros(1, np.int32), *arrays, np.zeros(1, np.int32)), 480, 270)
    np.testing.assert_array_equal(np.sort(tiles.entries), np.arange(len(tiles.entries)))
    assert not tiles.splats.any()
