"""Drawing a view again without some Gaussians gives what drawing the others gives."""

import numpy as np
import pytest
from little_scenes import random_splats, small_camera

from instdrive_core.rasterize.partial_redraw import redraw_without_rows
from instdrive_core.rasterize.render import render


@pytest.mark.parametrize(("share", "seed"), [(0.5, 1), (0.02, 2), (1.0, 3)])
def test_same_bits_as_drawing_the_others(share, seed):
    camera = small_camera(90, 70)
    means, quats, log_scales, opacities, channels = random_splats(camera, 600, 5, seed=seed).arrays()
    gone = np.random.default_rng(seed).random(600) < share
    raster = render(means, quats, log_scales, opacities, channels, camera)
    redrawn = redraw_without_rows(raster, gone)
    image, alpha = raster.image.copy(), raster.alpha.copy()
    image[redrawn.window], alpha[redrawn.window] = redrawn.image, redrawn.alpha
    others = render(means, quats, log_scales, np.where(gone, np.float32(0), opacities), channels, camera)
    np.testing.assert_array_equal(image, others.image)
    np.testing.assert_array_equal(alpha, others.alpha)


def test_only_what_may_change_is_drawn_again():
    camera = small_camera(90, 70)
    splats = random_splats(camera, 600, 3, seed=4)
    raster = render(*splats.arrays(), camera)
    gone = np.zeros(600, bool)
    assert redraw_without_rows(raster, gone).image.size == 0
    pixels, depths = camera.project(splats.means)
    inside = (depths > 0.5) & (np.abs(pixels - [45, 35]) < 10).all(axis=1)
    smallest = np.flatnonzero(inside)[np.argmin(splats.log_scales[inside].max(axis=1))]
    gone[smallest] = True
    redrawn = redraw_without_rows(raster, gone)
    column, row = np.floor(pixels[smallest]).astype(int)
    assert redrawn.window[0].start <= row < redrawn.window[0].stop
    assert redrawn.window[1].start <= column < redrawn.window[1].stop
    assert 0 < redrawn.alpha.size < 90 * 70


def test_it_leaves_the_first_drawing_alone():
    camera = small_camera(90, 70)
    raster = render(*random_splats(camera, 300, 3, seed=5).arrays(), camera)
    image = raster.image.copy()
    redraw_without_rows(raster, np.arange(300) % 2 == 0)
    np.testing.assert_array_equal(raster.image, image)
