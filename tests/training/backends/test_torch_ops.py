"""The torch form of a training step's operations against independent sources.

test_backends_agree.py holds it together with the CPU's kernels.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from skimage.metrics import structural_similarity

from instdrive_core.maths.rotations import matrix_from_quaternion, normalize_quaternions, quaternion_from_matrix
from instdrive_core.maths.spherical_harmonics import REST_COUNTS, evaluate_rest_basis, evaluate_view_colors
from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.scene.scene import place_in_world
from instdrive_core.scene.sky import Sky
from instdrive_core.training.backends import torch_ops

CAMERA = Camera(20.0, 21.0, 16.5, 12.0, 34, 25, look_at(np.array([0.3, 0, 1]), np.array([1.0, 0.4, 1.8])))
POSITION = np.array([1.0, -2, 0.5])


def leaf(array: np.ndarray) -> torch.Tensor:
    return torch.tensor(array, dtype=torch.float32, requires_grad=True)


def random_poses(rng: np.random.Generator, count: int) -> np.ndarray:
    """world_from_node: the world, then turned and shifted nodes."""
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[1:, :3, :3] = matrix_from_quaternion(rng.normal(size=(count - 1, 4)))
    poses[1:, :3, 3] = rng.normal(0, 5, (count - 1, 3))
    return poses


def slope(
    function: Callable[[torch.Tensor], torch.Tensor], at: torch.Tensor, direction: torch.Tensor, step: float = 1e-3
) -> float:
    """Numerical derivative along a direction."""
    with torch.no_grad():
        return float(function(at + step * direction).double() - function(at - step * direction).double()) / (2 * step)


class TestPlace:
    def setup_method(self) -> None:
        rng = np.random.default_rng(0)
        self.poses, self.nodes = random_poses(rng, 4), np.sort(rng.integers(0, 4, 50)).astype(np.uint16)
        self.means, self.quats = leaf(rng.normal(0, 2, (50, 3))), leaf(rng.normal(size=(50, 4)))
        self.rotations, self.shifts = leaf(self.poses[:, :3, :3]), leaf(self.poses[:, :3, 3])
        self.weights = [torch.tensor(rng.normal(size=shape), dtype=torch.float32) for shape in ((50, 3), (50, 4))]

    def loss(
        self, means: torch.Tensor, quats: torch.Tensor, rotations: torch.Tensor, shifts: torch.Tensor
    ) -> torch.Tensor:
        found = torch_ops.place_gaussians(means, quats, self.nodes, rotations, shifts)
        return sum(((value * weight).sum() for value, weight in zip(found, self.weights, strict=True)), torch.zeros(()))

    def test_places_as_the_scene_does(self) -> None:
        means, quats = torch_ops.place_gaussians(self.means, self.quats, self.nodes, self.rotations, self.shifts)
        arrays = self.means.detach().numpy(), self.quats.detach().numpy()
        wanted_means, wanted_quats = place_in_world(*arrays, self.nodes, self.poses)
        np.testing.assert_allclose(means.detach().numpy(), wanted_means, atol=2e-6)
        np.testing.assert_allclose(
            normalize_quaternions(quats.detach().numpy()), normalize_quaternions(wanted_quats), atol=2e-6
        )

    def test_gradients_are_those_of_finite_differences(self) -> None:
        inputs = [self.means, self.quats, self.rotations, self.shifts]
        self.loss(*inputs).backward()
        generator = torch.Generator().manual_seed(0)
        for place, value in enumerate(inputs):
            direction = torch.randn(value.shape, generator=generator)

            def moved(at: torch.Tensor, place: int = place) -> torch.Tensor:
                return self.loss(*(at if index == place else other for index, other in enumerate(inputs)))

            assert value.grad is not None
            analytic = float((value.grad * direction).sum())
            assert analytic == pytest.approx(slope(moved, value, direction), rel=0.02, abs=0.02)

    def test_the_world_stays(self) -> None:
        self.loss(self.means, self.quats, self.rotations, self.shifts).backward()
        assert self.rotations.grad is not None
        assert self.shifts.grad is not None
        assert not self.rotations.grad[0].any()
        assert not self.shifts.grad[0].any()
        nodes = np.zeros(50, np.uint16)
        means, quats = torch_ops.place_gaussians(self.means, self.quats, nodes, self.rotations, self.shifts)
        assert means is self.means
        assert quats is self.quats

    def test_quaternions_take_every_branch(self) -> None:
        quats = np.concatenate([np.eye(4), np.random.default_rng(1).normal(size=(40, 4))])
        matrices = matrix_from_quaternion(quats).astype(np.float32)
        found = torch_ops.quaternions_from_matrices(torch.from_numpy(matrices)).numpy()
        np.testing.assert_allclose(found, quaternion_from_matrix(matrices), atol=1e-6)


class TestHarmonics:
    @pytest.mark.parametrize("degree", range(4))
    def test_colors_are_those_of_maths(self, degree: int) -> None:
        rng, count = np.random.default_rng(degree), 60
        means, sh_dc = rng.normal(0, 3, (count, 3)), rng.normal(0, 1.5, (count, 3))
        sh_rest = rng.normal(0, 0.4, (count, REST_COUNTS[degree], 3))
        nodes, poses = rng.integers(0, 3, count).astype(np.uint16), random_poses(rng, 3)
        directions = means - POSITION
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        leaves = leaf(means), leaf(sh_dc), leaf(sh_rest)
        colors = torch_ops.evaluate_harmonics(*leaves, POSITION)
        wanted = evaluate_view_colors(sh_dc, sh_rest, directions)
        np.testing.assert_allclose(colors.detach().numpy(), wanted, atol=1e-5)
        assert (wanted == 0).any()  # clamped channels are in the test

        own_directions = np.einsum("nji,nj->ni", poses[nodes, :3, :3], directions)
        colors = torch_ops.evaluate_harmonics(*leaves, POSITION, nodes, poses)
        np.testing.assert_allclose(
            colors.detach().numpy(), evaluate_view_colors(sh_dc, sh_rest, own_directions), atol=1e-5
        )
        colors.sum().backward()
        assert leaves[0].grad is None
        assert leaves[1].grad is not None
        assert not leaves[1].grad[colors == 0].any()

    @pytest.mark.parametrize("count", REST_COUNTS[1:])
    def test_basis_is_that_of_maths(self, count: int) -> None:
        directions = np.random.default_rng(0).normal(size=(30, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        found = torch_ops.evaluate_basis(torch.from_numpy(directions), count).numpy()
        np.testing.assert_allclose(found, evaluate_rest_basis(directions, count), atol=1e-12)


class TestSky:
    @pytest.mark.parametrize("resolution", [1, 2, 7])
    @pytest.mark.parametrize("target", [(1.0, 0.4, 0.8), (-0.5, -1, -0.7), (0.2, 0.1, -1)])
    def test_composite_is_that_of_the_scene(self, resolution: int, target: tuple[float, float, float]) -> None:
        camera = Camera(12.0, 13.0, 16.5, 12.0, 34, 25, look_at(np.zeros(3), np.array(target)))
        rng = np.random.default_rng(0)
        image, faces = leaf(rng.random((25, 34, 3))), leaf(rng.random((6, resolution, resolution, 3)))
        alpha = leaf(0.99 * rng.random((25, 34)))
        composite = torch_ops.composite_over_sky(image, alpha, faces, camera)
        sky = Sky(faces.detach().numpy()).sample(camera.compute_ray_directions())
        wanted = image.detach().numpy() + (1 - alpha.detach().numpy()[:, :, None]) * sky
        np.testing.assert_allclose(composite.detach().numpy(), wanted, atol=1e-5)

    def test_hidden_sky_shows_nothing_and_learns_nothing(self) -> None:
        image, faces, alpha = leaf(np.zeros((25, 34, 3))), leaf(np.ones((6, 4, 4, 3))), leaf(np.full((25, 34), 0.9995))
        composite = torch_ops.composite_over_sky(image, alpha, faces, CAMERA)
        composite.sum().backward()
        assert not composite.any()
        assert alpha.grad is not None
        assert faces.grad is not None
        assert not alpha.grad.any()
        assert not faces.grad.any()


class TestPhotometric:
    def images(self, height: int = 40, width: int = 31) -> tuple[torch.Tensor, np.ndarray]:
        rng = np.random.default_rng(0)
        target = rng.integers(0, 256, (height, width, 3)).astype(np.uint8)
        return leaf(np.clip(target / 255 + rng.normal(0, 0.1, target.shape), -0.1, 1.1)), target

    def test_value_is_that_of_scikit_image_with_zeros_around(self) -> None:
        image, target = self.images()
        arrays = image.detach().numpy().astype(np.float64), target / 255
        padded = [np.pad(array, ((12, 12), (12, 12), (0, 0))) for array in arrays]
        options = {"data_range": 1.0, "gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
        _, similarity = structural_similarity(*padded, channel_axis=2, full=True, **options)
        l1 = np.abs(arrays[0] - arrays[1]).mean()
        loss, psnr = torch_ops.photometric_loss(image, target, None, 0.2)
        assert float(loss.detach()) == pytest.approx(0.8 * l1 + 0.2 * (1 - similarity[12:-12, 12:-12].mean()), abs=1e-4)
        mean_square = np.square(arrays[0].clip(0, 1) - arrays[1]).mean()
        assert psnr == pytest.approx(-10 * np.log10(mean_square), abs=1e-3)

    @pytest.mark.parametrize("ssim_weight", [0.0, 0.2, 1.0])
    @pytest.mark.parametrize("masked", [False, True])
    def test_gradient_is_that_of_finite_differences(self, ssim_weight: float, masked: bool) -> None:
        image, target = self.images()
        image = image.detach().double().requires_grad_(True)
        valid = np.random.default_rng(1).random(target.shape[:2]) < 0.8 if masked else None

        def loss(at: torch.Tensor) -> torch.Tensor:
            return torch_ops.photometric_loss(at, target, valid, ssim_weight)[0]

        loss(image).backward()
        assert image.grad is not None
        direction = torch.randn(image.shape, generator=torch.Generator().manual_seed(0))
        analytic = float((image.grad * direction).sum())
        assert analytic == pytest.approx(slope(loss, image, direction.double(), 1e-6), rel=1e-5)

    def test_the_ego_vehicle_counts_in_nothing(self) -> None:
        image, target = self.images()
        valid = np.ones(target.shape[:2], bool)
        valid[25:] = False
        loss, psnr = torch_ops.photometric_loss(image, target, valid, 0.2)
        loss.backward()
        assert image.grad is not None
        assert not image.grad[25:].any()
        with torch.no_grad():
            image[25:] = 0
        again, psnr_again = torch_ops.photometric_loss(image, target, valid, 0.2)
        assert float(again.detach()) == pytest.approx(float(loss.detach()))
        assert psnr_again == pytest.approx(psnr)
        above = np.square(image.detach().numpy()[:25].clip(0, 1) - target[:25] / 255).mean()
        assert psnr == pytest.approx(-10 * np.log10(above), abs=1e-3)

    def test_settings_of_cudnn_stay_as_they_were(self) -> None:
        before = torch.backends.cudnn.allow_tf32, torch.backends.cudnn.enabled
        image, target = self.images()
        torch_ops.photometric_loss(image, target, None, 0.2)
        assert (torch.backends.cudnn.allow_tf32, torch.backends.cudnn.enabled) == before


def test_exposure_is_affine() -> None:
    rng = np.random.default_rng(0)
    image, exposure = leaf(rng.random((5, 4, 3))), leaf(rng.normal(size=(3, 4)))
    found = torch_ops.expose(image, exposure)
    wanted = np.einsum("ij,hwj->hwi", exposure.detach()[:, :3], image.detach()) + exposure.detach()[:, 3].numpy()
    np.testing.assert_allclose(found.detach().numpy(), wanted, atol=1e-6)
    found.sum().backward()
    assert exposure.grad is not None
    assert image.grad is not None
    np.testing.assert_allclose(exposure.grad[0, :3].numpy(), image.detach().numpy().sum((0, 1)), rtol=1e-5)
    np.testing.assert_allclose(exposure.grad[:, 3].numpy(), 20)


def test_depth_loss_is_metres_at_drawn_pixels_with_lidar() -> None:
    depth, alpha = leaf(np.full((2, 3), 4.5)), leaf(np.array([[0.5, 0.5, 0.01], [0.5, 0, 1]]))
    pixels, lidar = np.array([0, 2, 4, 5], np.int32), np.array([10.0, 3, 3, 8], np.float32)
    loss = torch_ops.depth_loss(depth, alpha, pixels, lidar)
    assert float(loss.detach()) == pytest.approx((1 + 3.5) / 2)  # 4.5 / 0.5 against 10, 4.5 against 8
    loss.backward()
    assert depth.grad is not None
    assert alpha.grad is not None
    np.testing.assert_allclose(depth.grad.numpy(), [[-1, 0, 0], [0, 0, -0.5]])
    np.testing.assert_allclose(alpha.grad.numpy(), [[9, 0, 0], [0, 0, 2.25]])


@pytest.mark.parametrize("pixels", [[], [2, 4]])
def test_depth_loss_without_a_pixel_is_nothing(pixels: list[int]) -> None:
    depth, alpha = leaf(np.full((2, 3), 4.5)), leaf(np.zeros((2, 3)))
    loss = torch_ops.depth_loss(depth, alpha, np.array(pixels, np.int32), np.ones(len(pixels), np.float32))
    loss.backward()
    assert float(loss.detach()) == 0
    assert depth.grad is not None
    assert not depth.grad.any()


def test_opacity_loss_grows_with_opacity_inside_the_sky_only() -> None:
    sky = np.zeros((4, 4), bool)
    sky[0] = True
    alpha = leaf(np.array([[0.5] * 4, [0] * 4, [0] * 4, [1] * 4]))
    loss = torch_ops.opacity_loss(alpha, sky, solid=False)
    loss.backward()
    assert float(loss.detach()) == pytest.approx(np.log(2) / 4)
    assert alpha.grad is not None
    np.testing.assert_allclose(alpha.grad[0].numpy(), 2 / 16)
    assert not alpha.grad[1:].any()
    assert float(torch_ops.opacity_loss(torch.ones(4, 4), sky, solid=False)) == pytest.approx(-np.log(1e-4) / 4)


def test_arrays_that_must_not_be_written_are_copied() -> None:
    array = np.arange(3)
    array.setflags(write=False)
    tensor = torch_ops.to_device(array, torch.device("cpu"))
    tensor += 1
    np.testing.assert_array_equal(array, [0, 1, 2])
