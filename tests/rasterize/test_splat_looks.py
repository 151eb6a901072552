"""Splats as dots and as ellipses with rims."""

from dataclasses import replace

import numpy as np
import pytest

from instdrive_core.maths.activations import logit
from instdrive_core.maths.spherical_harmonics import dc_from_color
from instdrive_core.rasterize.pictures import draw_picture
from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import scene_from_gaussians

CAMERA = Camera(100.0, 100.0, 40.0, 30.0, 80, 60, look_at(np.array([0.0, -10.0, 0.0]), np.zeros(3)))
RED = (0.8, 0.2, 0.2)


@pytest.fixture
def scene():
    """A red ball of one metre at the middle, and a faint one beside it."""
    return scene_from_gaussians(
        Gaussians(
            means=np.array([[0, 0, 0], [2.5, 0, 0]], np.float32),
            quats=np.tile(np.float32([1, 0, 0, 0]), (2, 1)),
            log_scales=np.log(np.full((2, 3), 0.5, np.float32)),
            opacity_logits=logit(np.array([0.9, 0.1])).astype(np.float32),
            sh_dc=np.tile(dc_from_color(np.array(RED)).astype(np.float32), (2, 1)),
            sh_rest=np.zeros((2, 0, 3), np.float32),
            features=np.zeros((2, 0), np.float32),
        )
    )


def test_a_center_is_a_dot_of_its_colour_however_large_the_splat(scene):
    picture = draw_picture(scene, CAMERA, 0.0, "centers")
    lit = np.argwhere(picture.any(axis=2))
    assert len(lit) <= 36
    assert np.allclose(lit.mean(axis=0), [29.5, 39.5])
    assert np.abs(picture[29:31, 39:41] / 255 - RED).max() < 0.3
    near = replace(CAMERA, world_from_camera=look_at(np.array([0.0, -3.0, 0.0]), np.zeros(3)))
    assert np.array_equal(draw_picture(scene, near, 0.0, "centers").any(axis=2), picture.any(axis=2))


def test_an_ellipse_has_a_bright_rim_around_a_dark_inside(scene):
    picture = draw_picture(scene, CAMERA, 0.0, "rings", transparent=True)
    line = picture[30, :, 0].astype(int)
    inside = np.flatnonzero(picture[30, :, 3])
    # The edge is where 0.9 exp(-d² / 2) is 0.2, at 1.73 standard deviations of 5 pixels.
    assert inside[0] == pytest.approx(40 - 8.7, abs=1.0)
    assert inside[-1] == pytest.approx(39 + 8.7, abs=1.0)
    assert line[40] == pytest.approx(255 * 0.45 * RED[0], abs=2)
    assert line[inside[0]] == pytest.approx(255, abs=2)
    assert set(np.unique(picture[..., 3])) == {0, 255}
