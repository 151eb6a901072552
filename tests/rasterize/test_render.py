"""Values of the fast rasterizer against the readable one, and the cases that break rasterizers."""

from __future__ import annotations

import numpy as np
import pytest
from little_scenes import Splats, in_view, plain_splats, random_splats, small_camera

from instdrive_core.rasterize.kernels.project import _project
from instdrive_core.rasterize.kernels.settings import DEFAULT_SETTINGS, RasterSettings
from instdrive_core.rasterize.reference import render_reference
from instdrive_core.rasterize.render import render


def assert_like_reference(splats: Splats, camera, settings: RasterSettings = DEFAULT_SETTINGS) -> None:
    raster = render(*splats.arrays(), camera, settings)
    image, depth, alpha = render_reference(*splats.arrays(), camera, settings)
    np.testing.assert_allclose(raster.alpha, alpha, atol=2e-5)
    np.testing.assert_allclose(raster.image, image, atol=4e-5)
    np.testing.assert_allclose(raster.depth, depth, atol=4e-4)


@pytest.mark.parametrize("channels", [0, 1, 3, 11, 19])
def test_values_are_those_of_the_reference(channels: int) -> None:
    camera = small_camera()
    splats = random_splats(camera, 150, channels, seed=channels)
    assert_like_reference(splats, camera)
    assert render(*splats.arrays(), camera).alpha.max() > 0.9


@pytest.mark.parametrize("size", [(16, 16), (1, 1), (17, 15), (64, 33), (40, 96)])
def test_any_image_size_works(size: tuple[int, int]) -> None:
    camera = small_camera(*size)
    raster = render(*random_splats(camera, 60, 3, seed=4).arrays(), camera)
    assert raster.image.shape == (size[1], size[0], 3)
    assert_like_reference(random_splats(camera, 60, 3, seed=4), camera)


def test_opaque_stacks_stop_where_the_reference_stops() -> None:
    camera = small_camera()
    splats = random_splats(camera, 400, 3, seed=9, opacity=(0.7, 1.0))
    assert_like_reference(splats, camera)
    coarse = RasterSettings(min_transmittance=0.05, max_alpha=0.9, min_alpha=0.02, low_pass=0.1, near=4.0)
    assert_like_reference(splats, camera, coarse)


def test_nothing_to_draw_gives_an_empty_picture() -> None:
    camera = small_camera()
    raster = render(*random_splats(camera, 0, 5, seed=0).arrays(), camera)
    assert raster.image.shape == (37, 53, 5)
    assert not raster.image.any()
    assert not raster.depth.any()
    assert not raster.alpha.any()


def test_splats_behind_the_camera_off_the_image_or_transparent_draw_nothing() -> None:
    camera = small_camera()
    behind = plain_splats(camera, [[25, 18], [25, 18]], [-3.0, 0.05], 3, 0.9)
    beside = plain_splats(camera, [[-200, 18], [25, 900]], [3.0, 3.0], 3, 0.9)
    clear = plain_splats(camera, [[25, 18], [25, 18]], [3.0, 4.0], 3, 0.0)
    clear.opacities[1] = 0.9 / 255
    for splats in (behind, beside, clear):
        splats.log_scales[:] = np.log(0.1)
        raster = render(*splats.arrays(), camera)
        assert not raster.alpha.any()
        assert not len(raster.context.projection.rows) or not len(raster.context.tiles.splats)


def test_splats_that_are_not_finite_do_not_spoil_the_others() -> None:
    camera = small_camera()
    good = random_splats(camera, 30, 3, seed=2)
    bad = random_splats(camera, 6, 3, seed=3)
    bad.means[0] = np.nan
    bad.means[1] = np.inf
    bad.log_scales[2] = 200
    bad.quats[3] = 0
    bad.opacities[4] = np.nan
    bad.log_scales[5, 1] = np.nan
    expected, found = render(*good.arrays(), camera), render(*good.joined(bad).arrays(), camera)
    np.testing.assert_array_equal(found.image, expected.image)


def test_a_splat_of_the_size_of_the_world_and_one_far_below_a_pixel() -> None:
    camera = small_camera()
    huge = plain_splats(camera, [[20, 20]], [5.0], 4000, 0.5)
    assert_like_reference(huge, camera)
    tiny = plain_splats(camera, [[20.5, 20.5], [30.4, 11.7], [0.5, 0.5]], [5.0, 6.0, 7.0], 1e-4, 0.8)
    assert_like_reference(tiny, camera)
    assert render(*tiny.arrays(), camera).alpha[20, 20] == pytest.approx(0.8, abs=1e-4)


def test_a_long_splat_crosses_many_tiles() -> None:
    camera = small_camera(200, 120)
    splats = plain_splats(camera, [[100, 60]], [5.0], 1.0, 0.9)
    splats.log_scales[0, 0] += np.log(60)
    splats.quats[0] = [0.9, 0.1, 0.3, 0.35]
    assert_like_reference(splats, camera)


def test_splats_beside_the_camera_stay_bounded_by_the_clamped_jacobian() -> None:
    camera = small_camera()
    points = in_view(camera, np.array([[-90.0, 18], [140, 20]]), np.array([0.2, 0.3]))
    splats = plain_splats(camera, [[0, 0], [0, 0]], [1.0, 1.0], 1.0, 0.9)
    splats.means[:] = points
    splats.log_scales[:] = np.log(0.2)
    assert_like_reference(splats, camera)


def test_equal_depths_are_blended_in_row_order() -> None:
    camera = small_camera()
    splats = plain_splats(camera, [[25, 18]] * 2, [4.0, 4.0], 3, 0.9)
    raster = render(*splats.arrays(), camera)
    first, second = splats.channels[:, 0]
    middle = raster.image[18, 25, 0] / raster.alpha[18, 25]
    assert abs(middle - first) < abs(middle - second)


def test_settings_that_the_kernels_cannot_honour_are_refused() -> None:
    with pytest.raises(ValueError, match="min_alpha"):
        RasterSettings(min_alpha=1e-3)


def test_any_memory_layout_is_taken_without_compiling_anew() -> None:
    camera = small_camera()
    splats = random_splats(camera, 40, 3, seed=7)
    expected = render(*splats.arrays(), camera).image
    compiled = len(_project.signatures)
    odd = [np.asfortranarray(array).astype(np.float64) for array in splats.arrays()]
    for array in odd:
        array.flags.writeable = False
    frozen = [array.copy() for array in splats.arrays()]
    for array in frozen:
        array.flags.writeable = False
    for arrays in (odd, frozen):
        np.testing.assert_array_equal(render(*arrays, camera).image, expected)
    assert len(_project.signatures) == compiled
