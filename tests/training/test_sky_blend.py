"""The sky behind the Gaussians: equal to the scene's own sky, with right gradients."""

import numpy as np
import pytest
import torch

from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.scene.sky import Sky
from instdrive_core.training.sky_blend import over_sky

CAMERA = Camera(20.0, 20.0, 16.0, 12.0, 32, 24, look_at(np.zeros(3), np.array([1.0, 0.4, 0.8])))


def inputs():
    rng = np.random.default_rng(0)
    shapes = [(24, 32, 3), (24, 32), (6, 5, 5, 3)]
    return [torch.from_numpy((0.9 * rng.random(shape)).astype(np.float32)).requires_grad_(True) for shape in shapes]


def test_composite_equals_the_scene_sky():
    image, alpha, faces = inputs()
    sky = Sky(faces.detach().numpy()).colors(CAMERA.ray_directions())
    expected = image.detach().numpy() + (1 - alpha.detach().numpy()[..., None]) * sky
    np.testing.assert_allclose(over_sky(image, alpha, faces, CAMERA).detach(), expected, atol=1e-5)


@pytest.mark.parametrize("which", [0, 1, 2])
def test_gradients_are_those_of_finite_differences(which):
    values = inputs()
    weights = torch.randn(24, 32, 3, generator=torch.Generator().manual_seed(0))
    (over_sky(*values, CAMERA) * weights).sum().backward()
    direction = torch.randn(values[which].shape, generator=torch.Generator().manual_seed(1))
    results = []
    for sign in (1, -1):
        moved = [value.detach().clone() for value in values]
        moved[which] += sign * 1e-2 * direction
        results.append(float((over_sky(*moved, CAMERA).double() * weights).sum()))
    analytic = float((values[which].grad * direction).sum())
    assert analytic == pytest.approx((results[0] - results[1]) / 2e-2, rel=0.02)
