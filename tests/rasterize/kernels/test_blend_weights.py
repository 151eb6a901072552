"""The sparse blending weights against what `render` shows."""

from __future__ import annotations

import numpy as np
import pytest
from little_scenes import random_splats, small_camera

from instdrive_core.rasterize.kernels.blend_weights import (
    BlendWeights,
    apply_weights,
    compact_weights,
    compute_blend_weights,
    transpose_weights,
)
from instdrive_core.rasterize.render import render


def dense(weights: BlendWeights, count: int) -> np.ndarray:
    matrix = np.zeros((len(weights.indptr) - 1, count))
    pixels = np.repeat(np.arange(len(matrix)), np.diff(weights.indptr))
    np.add.at(matrix, (pixels, weights.rows), weights.weights)
    return matrix


def test_blended_features_are_those_of_render() -> None:
    camera = small_camera(90, 70)
    splats = random_splats(camera, 600, 16, seed=1)
    raster = render(*splats.arrays(), camera)
    pixels = np.random.default_rng(0).permutation(90 * 70)[:1500]
    weights = compute_blend_weights(*splats.arrays()[:4], camera, pixels)
    expected = raster.image.reshape(-1, 16)[pixels]
    np.testing.assert_allclose(apply_weights(weights, splats.channels), expected, atol=1e-5)
    np.testing.assert_allclose(dense(weights, 600).sum(axis=1), raster.alpha.ravel()[pixels], atol=1e-5)


def test_entries_of_a_pixel_come_front_to_back() -> None:
    camera = small_camera()
    splats = random_splats(camera, 200, 0, seed=2)
    weights = compute_blend_weights(*splats.arrays()[:4], camera, np.arange(53 * 37))
    depths = camera.project(splats.means)[1][weights.rows]
    inside = np.ones(len(depths), bool)
    inside[weights.indptr[:-1][weights.indptr[:-1] < len(depths)]] = False
    assert inside.sum() > 1000
    assert (np.diff(depths)[inside[1:]] >= -1e-6).all()


def test_pixels_may_repeat_and_come_in_any_order() -> None:
    camera = small_camera()
    splats = random_splats(camera, 100, 2, seed=3)
    pixels = np.array([900, 3, 900, 1200, 3], np.int32)
    blended = apply_weights(compute_blend_weights(*splats.arrays()[:4], camera, pixels), splats.channels)
    np.testing.assert_array_equal(blended[0], blended[2])
    np.testing.assert_array_equal(blended[1], blended[4])


def test_transposed_is_the_adjoint_and_repeats_bit_by_bit() -> None:
    camera = small_camera()
    splats = random_splats(camera, 150, 0, seed=4)
    weights = compute_blend_weights(*splats.arrays()[:4], camera, np.arange(0, 53 * 37, 3))
    grad = np.random.default_rng(0).normal(size=(len(weights.indptr) - 1, 5)).astype(np.float32)
    full = apply_weights(transpose_weights(weights, 200), grad)
    assert full.shape == (200, 5)
    np.testing.assert_allclose(full, dense(weights, 200).T @ grad, atol=1e-4)
    np.testing.assert_array_equal(full, apply_weights(transpose_weights(weights, 200), grad))


def test_entries_of_a_gaussian_come_in_the_order_of_the_pixels() -> None:
    weights = BlendWeights(np.array([0, 2, 2, 4]), np.array([3, 1, 1, 0], np.int32), np.arange(4, dtype=np.float32))
    turned = transpose_weights(weights, 5)
    assert turned.indptr.tolist() == [0, 1, 3, 3, 4, 4]
    assert turned.rows.tolist() == [2, 0, 2, 0]
    assert turned.weights.tolist() == [3, 1, 2, 0]


def test_compacted_weights_blend_the_same_from_the_rows_they_need() -> None:
    camera = small_camera()
    splats = random_splats(camera, 400, 3, seed=6)
    weights = compute_blend_weights(*splats.arrays()[:4], camera, np.arange(0, 53 * 37, 41))
    rows, little = compact_weights(weights, 400)
    assert rows.tolist() == sorted(set(weights.rows.tolist()))
    assert len(rows) < 400
    np.testing.assert_array_equal(apply_weights(little, splats.channels[rows]), apply_weights(weights, splats.channels))


def test_the_matrix_without_some_pixels() -> None:
    camera = small_camera()
    splats = random_splats(camera, 100, 3, seed=7)
    weights = compute_blend_weights(*splats.arrays()[:4], camera, np.arange(53 * 37))
    kept = np.random.default_rng(0).uniform(size=53 * 37) < 0.3
    blended = apply_weights(weights.select_pixels(kept), splats.channels)
    np.testing.assert_array_equal(blended, apply_weights(weights, splats.channels)[kept])


def test_nothing_asked_or_nothing_there() -> None:
    camera = small_camera()
    splats = random_splats(camera, 20, 0, seed=5)
    none = compute_blend_weights(*splats.arrays()[:4], camera, np.zeros(0, np.int64))
    assert none.indptr.tolist() == [0]
    assert apply_weights(none, np.ones((20, 4))).shape == (0, 4)
    assert not apply_weights(transpose_weights(none, 20), np.zeros((0, 4))).any()
    empty = compute_blend_weights(*random_splats(camera, 0, 0, seed=5).arrays()[:4], camera, np.array([0, 5]))
    assert empty.indptr.tolist() == [0, 0, 0]
    assert not apply_weights(empty, np.zeros((0, 3))).any()


@pytest.mark.parametrize("pixel", [-1, 53 * 37])
def test_pixels_outside_the_image_are_refused(pixel: int) -> None:
    camera = small_camera()
    with pytest.raises(ValueError, match="leave the 53"):
        compute_blend_weights(*random_splats(camera, 3, 0, seed=5).arrays()[:4], camera, np.array([4, pixel]))
