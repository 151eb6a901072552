"""Scenes whose splats fade as the low-pass widens them (Mip-Splatting)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from little_scenes import Splats, plain_splats, random_splats, small_camera
from pixel_walks import find_pixel_contributors

from instdrive_core.rasterize.kernels.settings import DEFAULT_SETTINGS, RasterSettings, choose_raster_settings
from instdrive_core.rasterize.pixel_contributors import pick_winner
from instdrive_core.rasterize.preview import render_preview
from instdrive_core.rasterize.reference import render_reference
from instdrive_core.rasterize.render import render, render_backward
from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import scene_from_gaussians

ANTIALIASED = RasterSettings(antialiased=True)


def fine_splats(camera, seed: int = 0) -> Splats:
    """Splats of a fraction of a pixel to a few."""
    splats = random_splats(camera, 500, 3, seed, opacity=(0.3, 0.95))
    return replace(splats, log_scales=splats.log_scales - np.float32(1.5))


def test_values_are_those_of_the_reference() -> None:
    camera = small_camera()
    splats = fine_splats(camera)
    raster = render(*splats.arrays(), camera, ANTIALIASED)
    image, _, alpha = render_reference(*splats.arrays(), camera, ANTIALIASED)
    np.testing.assert_allclose(raster.alpha, alpha, atol=2e-5)
    np.testing.assert_allclose(raster.image, image, atol=4e-5)
    frame = render_preview(*splats.arrays(), camera, ANTIALIASED)
    np.testing.assert_allclose(frame.alpha, alpha, atol=2e-4)
    assert render(*splats.arrays(), camera).alpha.mean() > 1.2 * alpha.mean()


def test_a_splat_hides_as_much_in_all_as_without_the_low_pass() -> None:
    camera = small_camera()
    for radius in (0.4, 0.7, 1.5):
        splat = plain_splats(camera, [[26.5, 18.5]], [5.0], radius, 0.9)
        faded = render(*splat.arrays(), camera, replace(ANTIALIASED, min_alpha=1 / 256)).alpha.sum()
        # A flat picture of a round splat near the axis; the pixels' aspect is that of the camera.
        assert faded == pytest.approx(0.9 * 2 * np.pi * radius**2 * camera.fy / camera.fx, rel=0.12)


def test_a_pixel_alone_agrees_with_the_frame() -> None:
    camera = small_camera(120, 80)
    splats = fine_splats(camera, seed=3)
    frame = render_preview(*splats.arrays(), camera, ANTIALIASED)
    rng = np.random.default_rng(0)
    agreeing = 0
    for x, y in zip(rng.integers(0, 120, 200), rng.integers(0, 80, 200), strict=True):
        contributors = find_pixel_contributors(*splats.arrays()[:4], camera, int(x), int(y), ANTIALIASED)
        assert contributors.weights.sum() == pytest.approx(frame.alpha[y, x], abs=1e-5)
        agreeing += pick_winner(contributors) == frame.winner[y, x]
    assert agreeing >= 199


def test_scenes_are_drawn_as_they_say() -> None:
    camera = small_camera()
    splats = fine_splats(camera)
    logits = np.log(splats.opacities / (1 - splats.opacities))
    none = np.zeros((len(splats), 0, 3), np.float32)
    shape = (splats.means, splats.quats, splats.log_scales, logits)
    scene = scene_from_gaussians(Gaussians(*shape, splats.channels, none, none[:, :, 0]))
    assert choose_raster_settings(scene) == DEFAULT_SETTINGS
    plain = view_scene(scene, camera, 0.0).alpha
    scene.antialiased = True
    np.testing.assert_allclose(
        view_scene(scene, camera, 0.0).alpha, render_preview(*splats.arrays(), camera, ANTIALIASED).alpha, atol=1e-5
    )
    assert plain.mean() > 1.2 * view_scene(scene, camera, 0.0).alpha.mean()


def test_gradients_are_refused() -> None:
    camera = small_camera()
    raster = render(*fine_splats(camera).arrays(), camera, ANTIALIASED)
    with pytest.raises(ValueError, match="antialiased"):
        render_backward(raster.context, raster.image, raster.depth, raster.alpha, 3)
