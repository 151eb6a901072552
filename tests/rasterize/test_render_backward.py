"""Gradients of the fast rasterizer against central differences of the float64 reference."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from little_scenes import Splats, plain_splats, random_splats, small_camera

from instdrive_core.rasterize import reference
from instdrive_core.rasterize.render import RasterGradients, render, render_backward
from instdrive_core.scene.camera import Camera

NAMES = ("means", "quats", "log_scales", "opacities", "channels")


class LinearLoss:
    """A random linear loss of image, depth and alpha; its differences keep the fragments that the scene itself keeps,
    because where a fragment appears or ends is not what the gradient describes."""

    def __init__(self, splats: Splats, camera: Camera, geometry_channels: int, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        shape = (camera.height, camera.width)
        self.grads = [
            rng.normal(size=(*shape, splats.channels.shape[1])),
            rng.normal(size=shape),
            rng.normal(size=shape),
        ]
        self.splats, self.camera, self.geometry_channels = splats, camera, geometry_channels
        found = reference.evaluate_fragments(*splats.arrays()[:4], camera)
        self.kept = reference.find_blended_fragments(found)
        self.weights = reference.compute_fragment_weights(found, self.kept)

    def gradients(self) -> RasterGradients:
        raster = render(*self.splats.arrays(), self.camera)
        return render_backward(raster.context, *self.grads, self.geometry_channels)

    def value(self, splats: Splats) -> float:
        """Loss whose features beyond the geometry channels are blended with the weights of the unchanged scene."""
        found = reference.evaluate_fragments(*splats.arrays()[:4], self.camera)
        image, depth, alpha = reference.sum_fragments(
            found, reference.compute_fragment_weights(found, self.kept), splats.channels
        )
        detached, _, _ = reference.sum_fragments(found, self.weights, splats.channels)
        image = np.concatenate([image[..., : self.geometry_channels], detached[..., self.geometry_channels :]], axis=-1)
        return sum(float((g * o).sum()) for g, o in zip(self.grads, (image, depth, alpha), strict=True))

    def difference(self, name: str, index: tuple, step: float = 1e-5) -> float:
        values = []
        for sign in (1, -1):
            array = getattr(self.splats, name).astype(np.float64)
            array[index] += sign * step
            values.append(self.value(replace(self.splats, **{name: array})))
        return (values[0] - values[1]) / (2 * step)

    def check(self, rows: np.ndarray) -> None:
        gradients = self.gradients()
        for name in NAMES:
            analytic = getattr(gradients, name)[rows]
            numeric = np.array(
                [self.difference(name, (rows[index[0]], *index[1:])) for index in np.ndindex(analytic.shape)]
            ).reshape(analytic.shape)
            scale = np.abs(numeric).max(initial=1e-6)
            np.testing.assert_allclose(analytic / scale, numeric / scale, atol=3e-4, err_msg=name)


@pytest.mark.parametrize(("channels", "geometry_channels"), [(3, 3), (11, 3), (8, 8), (5, 0), (0, 0), (9, 4)])
def test_every_gradient_agrees_with_differences(channels: int, geometry_channels: int) -> None:
    camera = small_camera(37, 29)
    splats = random_splats(camera, 25, channels, seed=31 + channels)
    loss = LinearLoss(splats, camera, geometry_channels)
    loss.check(np.flatnonzero(loss.gradients().visible)[:6])


def test_gradients_of_clamped_splats_beside_the_camera() -> None:
    camera = small_camera(37, 29)
    splats = plain_splats(camera, [[-14, 12], [50, 16], [16, -11]], [0.7, 0.8, 0.9], 8, 0.8)
    splats.quats[:] = np.random.default_rng(0).normal(size=(3, 4))
    splats.log_scales += np.random.default_rng(1).normal(0, 0.2, (3, 3)).astype(np.float32)
    loss = LinearLoss(splats, camera, 3)
    assert loss.gradients().visible.all()
    loss.check(np.arange(3))


def test_gradients_through_a_stack_that_ends_early() -> None:
    camera = small_camera(20, 18)
    splats = random_splats(camera, 120, 3, seed=5, opacity=(0.8, 0.98))
    loss = LinearLoss(splats, camera, 3)
    unfinished = loss.kept | (reference.evaluate_fragments(*splats.arrays()[:4], camera).raw_alphas < 1 / 255)
    assert not unfinished.all()
    loss.check(np.flatnonzero(loss.gradients().visible)[::12])


def test_depth_alone_moves_a_splat_along_the_ray() -> None:
    camera = small_camera()
    splats = plain_splats(camera, [[25.5, 18.5]], [4.0], 3, 0.9)
    raster = render(*splats.arrays(), camera)
    zero = np.zeros_like(raster.depth)
    grad_depth = zero.copy()
    grad_depth[18, 25] = 1
    gradients = render_backward(raster.context, np.zeros_like(raster.image), grad_depth, zero, 3)
    forward = camera.world_from_camera[:3, 2]
    assert gradients.means[0] @ forward == pytest.approx(raster.alpha[18, 25], rel=1e-3)


def test_features_beyond_the_geometry_channels_leave_geometry_alone() -> None:
    camera = small_camera()
    splats = random_splats(camera, 80, 11, seed=8)
    raster = render(*splats.arrays(), camera)
    rng = np.random.default_rng(0)
    zero, grad = np.zeros_like(raster.depth), np.zeros_like(raster.image)
    grad[..., 3:] = rng.normal(size=grad[..., 3:].shape)
    gradients = render_backward(raster.context, grad, zero, zero, 3)
    for name in ("means", "quats", "log_scales", "opacities", "means2d_abs"):
        assert not getattr(gradients, name).any(), name
    assert not gradients.channels[:, :3].any()
    assert gradients.channels[:, 3:].any()


def test_the_same_input_gives_the_same_bits() -> None:
    camera = small_camera(200, 150)
    splats = random_splats(camera, 2000, 11, seed=6)
    rng = np.random.default_rng(1)
    grads = [rng.normal(size=(150, 200, 11)), rng.normal(size=(150, 200)), rng.normal(size=(150, 200))]
    runs = []
    for _ in range(3):
        raster = render(*splats.arrays(), camera)
        gradients = render_backward(raster.context, *grads, 3)
        runs.append([raster.image, raster.depth, raster.alpha, *(getattr(gradients, name) for name in NAMES)])
    for other in runs[1:]:
        for left, right in zip(runs[0], other, strict=True):
            np.testing.assert_array_equal(left, right)


def test_statistics_for_densification() -> None:
    camera = small_camera()
    splats = plain_splats(camera, [[25.5, 18.5], [-400, 18]], [4.0, 4.0], 3, 0.9)
    raster = render(*splats.arrays(), camera)
    rng = np.random.default_rng(2)
    grad = np.repeat(rng.normal(size=(37, 53, 1)), 3, axis=2)
    gradients = render_backward(raster.context, grad, np.zeros((37, 53)), np.zeros((37, 53)), 3)
    assert gradients.visible.tolist() == [True, False]
    assert gradients.means2d_abs[1] == 0

    y, x = np.mgrid[:37, :53] + 0.5
    conic = np.linalg.inv(_matrix(raster.context.projection.covariances[0]))
    offsets = np.stack([x, y], -1) - raster.context.projection.splats[0, :2]
    pull = offsets @ conic * (grad[..., 0] * raster.image[..., 0])[..., None]
    expected = np.linalg.norm(np.abs(pull).sum(axis=(0, 1)))
    assert gradients.means2d_abs[0] == pytest.approx(expected, rel=1e-3)


def test_nothing_rendered_sends_nothing_back() -> None:
    camera = small_camera()
    raster = render(*random_splats(camera, 0, 3, seed=0).arrays(), camera)
    gradients = render_backward(raster.context, raster.image, raster.depth, raster.alpha, 3)
    assert gradients.means.shape == (0, 3)
    with pytest.raises(ValueError, match="geometry_channels"):
        render_backward(raster.context, raster.image, raster.depth, raster.alpha, 4)


def _matrix(covariance: np.ndarray) -> np.ndarray:
    xx, xy, yy = covariance
    return np.array([[xx, xy], [xy, yy]])
