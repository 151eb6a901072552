"""The CPU's operations together: each gives the same bits again, whatever the number of threads."""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np
import pytest
import torch
from torch import Tensor

from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.training.backends.backend import SeenSplats
from instdrive_core.training.backends.cpu_backend import CpuBackend

BACKEND = CpuBackend()
HEIGHT, WIDTH, COUNT, NODE_COUNT = 70, 90, 3_000, 5
CAMERA = Camera(60.0, 60.0, 45.0, 35.0, WIDTH, HEIGHT, look_at(np.array([0.0, -6, 1]), np.array([0.0, 0, 0.5])))
RNG = np.random.default_rng(0)
NODES = np.sort(RNG.integers(0, NODE_COUNT, COUNT)).astype(np.uint16)
ROTATIONS, SHIFTS = matrix_from_quaternion(RNG.normal(size=(NODE_COUNT, 4))), RNG.normal(size=(NODE_COUNT, 3))
ROTATIONS[0], SHIFTS[0] = np.eye(3), 0
POSES = np.tile(np.eye(4), (NODE_COUNT, 1, 1))
POSES[:, :3, :3], POSES[:, :3, 3] = ROTATIONS, SHIFTS
TARGET = RNG.integers(0, 256, (HEIGHT, WIDTH, 3)).astype(np.uint8)
MASK = RNG.random((HEIGHT, WIDTH)) < 0.8
PIXELS = np.arange(0, HEIGHT * WIDTH, 7, dtype=np.int32)
LIDAR = RNG.uniform(2, 40, len(PIXELS)).astype(np.float32)

Operation = Callable[[], tuple[list[Tensor], list[Tensor]]]
"""Runs forward and returns inputs that have a gradient, and outputs."""


def leaves(*shapes: tuple[int, ...], low: float = -1.0) -> list[Tensor]:
    rng = np.random.default_rng(7)
    return [torch.tensor(rng.uniform(low, 1, shape), dtype=torch.float32, requires_grad=True) for shape in shapes]


def rasterized() -> tuple[list[Tensor], list[Tensor]]:
    inputs = leaves((COUNT, 3), (COUNT, 4), (COUNT, 3), (COUNT,), (COUNT, 5))
    means, quats, log_scales, logits, channels = inputs
    return inputs, list(BACKEND.rasterize(means, quats, log_scales - 3, logits, channels, CAMERA, 3, SeenSplats()))


def colored() -> tuple[list[Tensor], list[Tensor]]:
    means, *inputs = leaves((COUNT, 3), (COUNT, 3), (COUNT, 8, 3))
    return inputs, [BACKEND.evaluate_harmonics(means, *inputs, CAMERA.position, NODES, POSES)]


def placed() -> tuple[list[Tensor], list[Tensor]]:
    poses = [torch.tensor(array, dtype=torch.float32, requires_grad=True) for array in (ROTATIONS, SHIFTS)]
    inputs = [*leaves((COUNT, 3), (COUNT, 4)), *poses]
    return inputs, list(BACKEND.place_gaussians(inputs[0], inputs[1], NODES, *poses))


def over_sky() -> tuple[list[Tensor], list[Tensor]]:
    inputs = leaves((HEIGHT, WIDTH, 3), (HEIGHT, WIDTH), (6, 16, 16, 3), low=0)
    return inputs, [BACKEND.composite_over_sky(*inputs, CAMERA)]


def exposed() -> tuple[list[Tensor], list[Tensor]]:
    inputs = leaves((HEIGHT, WIDTH, 3), (3, 4))
    return inputs, [BACKEND.expose(*inputs)]


def photometric() -> tuple[list[Tensor], list[Tensor]]:
    inputs = leaves((HEIGHT, WIDTH, 3), low=0)
    return inputs, [BACKEND.photometric_loss(inputs[0], TARGET, MASK, 0.2)[0]]


def depth() -> tuple[list[Tensor], list[Tensor]]:
    inputs = leaves((HEIGHT, WIDTH), (HEIGHT, WIDTH), low=0)
    return inputs, [BACKEND.depth_loss(*inputs, PIXELS, LIDAR)]


def opacity() -> tuple[list[Tensor], list[Tensor]]:
    inputs = leaves((HEIGHT, WIDTH), low=0)
    return inputs, [BACKEND.opacity_loss(*inputs, MASK, solid=False), BACKEND.opacity_loss(*inputs, MASK, solid=True)]


OPERATIONS = [rasterized, colored, placed, over_sky, exposed, photometric, depth, opacity]


def bits(operation: Operation, threads: int) -> list[bytes]:
    before = numba.get_num_threads()
    numba.set_num_threads(threads)
    try:
        inputs, outputs = operation()
        weights = [torch.randn(output.shape, generator=torch.Generator().manual_seed(1)) for output in outputs]
        grads = torch.autograd.grad(outputs, inputs, weights)
        assert all(float(grad.abs().sum()) > 0 for grad in grads)
        return [tensor.detach().numpy().tobytes() for tensor in (*outputs, *grads)]
    finally:
        numba.set_num_threads(before)


@pytest.mark.parametrize("operation", OPERATIONS)
def test_the_same_bits_again_and_with_any_number_of_threads(operation: Operation) -> None:
    several = min(3, numba.config.NUMBA_NUM_THREADS)  # pyright: ignore[reportAttributeAccessIssue]
    first = bits(operation, several)
    assert bits(operation, several) == first
    assert bits(operation, 1) == first


@pytest.mark.parametrize("operation", OPERATIONS)
def test_gradients_come_as_single_precision_of_the_inputs_shape(operation: Operation) -> None:
    inputs, outputs = operation()
    for tensor, grad in zip(inputs, torch.autograd.grad([o.sum() for o in outputs], inputs), strict=True):
        assert grad.shape == tensor.shape
        assert grad.dtype == torch.float32
        assert bool(grad.isfinite().all())


def test_a_slice_of_an_image_will_do() -> None:
    image, alpha, faces = leaves((HEIGHT, WIDTH, 5), (HEIGHT, WIDTH), (6, 4, 4, 3), low=0)
    whole = BACKEND.composite_over_sky(image[..., :3].contiguous(), alpha, faces, CAMERA)
    part = BACKEND.composite_over_sky(image[..., :3], alpha, faces, CAMERA)
    np.testing.assert_array_equal(part.detach(), whole.detach())
    part.square().sum().backward()
    assert not image.grad[..., 3:].any()
    assert image.grad[..., :3].any()
