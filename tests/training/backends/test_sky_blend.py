"""The sky behind the Gaussians: equal to the scene's own sky, with right gradients."""

import numpy as np
import pytest
import torch

from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.scene.sky import Sky
from instdrive_core.training.backends.sky_blend import composite_over_sky

CAMERA = Camera(20.0, 20.0, 16.0, 12.0, 32, 24, look_at(np.zeros(3), np.array([1.0, 0.4, 0.8])))


def inputs():
    rng = np.random.default_rng(0)
    shapes = [(24, 32, 3), (24, 32), (6, 5, 5, 3)]
    return [torch.from_numpy((0.9 * rng.random(shape)).astype(np.float32)).requires_grad_(True) for shape in shapes]


def test_composite_equals_the_scene_sky():
    image, alpha, faces = inputs()
    sky = Sky(faces.detach().numpy()).sample(CAMERA.compute_ray_directions())
    expected = image.detach().numpy() + (1 - alpha.detach().numpy()[..., None]) * sky
    np.testing.assert_allclose(composite_over_sky(image, alpha, faces, CAMERA).detach(), expected, atol=1e-5)


@pytest.mark.parametrize("which", [0, 1, 2])
def test_gradients_are_those_of_finite_differences(which):
    values = inputs()
    weights = torch.randn(24, 32, 3, generator=torch.Generator().manual_seed(0))
    (composite_over_sky(*values, CAMERA) * weights).sum().backward()
    direction = torch.randn(values[which].shape, generator=torch.Generator().manual_seed(1))
    results = []
    for sign in (1, -1):
        moved = [value.detach().clone() for value in values]
        moved[which] += sign * 1e-2 * direction
        results.append(float((composite_over_sky(*moved, CAMERA).double() * weights).sum()))
    analytic = float((values[which].grad * direction).sum())
    assert analytic == pytest.approx((results[0] - results[1]) / 2e-2, rel=0.02)


def test_every_face_and_border_is_looked_up_as_in_the_scene():
    faces = torch.rand(6, 7, 7, 3, generator=torch.Generator().manual_seed(4))
    for target in np.concatenate([np.eye(3), -np.eye(3), [[1, 1, 1], [-1, 1, -1], [1, -1, 0.2]]]):
        aside = target + np.array([0.013, 0.029, 0.007])  # no ray exactly between two faces, where either is right
        camera = Camera(6.0, 6.1, 16.2, 12.1, 32, 24, look_at(np.zeros(3), aside))
        found = composite_over_sky(torch.zeros(24, 32, 3), torch.zeros(24, 32), faces, camera)
        np.testing.assert_allclose(found, Sky(faces.numpy()).sample(camera.compute_ray_directions()), atol=2e-5)


@pytest.mark.parametrize("resolution", [1, 2])
def test_the_smallest_faces_do(resolution):
    faces = torch.rand(6, resolution, resolution, 3, generator=torch.Generator().manual_seed(5)).requires_grad_(True)
    image = composite_over_sky(torch.zeros(24, 32, 3), torch.zeros(24, 32), faces, CAMERA)
    expected = Sky(faces.detach().numpy()).sample(CAMERA.compute_ray_directions())
    np.testing.assert_allclose(image.detach(), expected, atol=1e-5)
    image.sum().backward()
    assert float(faces.grad.sum()) == pytest.approx(24 * 32 * 3, rel=1e-4)


def test_where_no_sky_shows_nothing_changes_and_nothing_is_sent_back():
    image, _, faces = inputs()
    alpha = torch.ones(24, 32, requires_grad=True)
    result = composite_over_sky(image, alpha, faces, CAMERA)
    np.testing.assert_array_equal(result.detach(), image.detach())
    result.square().sum().backward()
    assert not alpha.grad.any()
    assert not faces.grad.any()
    np.testing.assert_array_equal(image.grad, 2 * image.detach())
