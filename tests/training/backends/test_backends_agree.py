"""Every operation of a training step gives the same values and gradients on the CPU's kernels and in torch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
import torch
from torch import Tensor
from torch_splatting import GPU, backend_of

from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.training.backends.backend import Backend
from instdrive_core.training.backends.cpu_backend import CpuBackend

CAMERA = Camera(12.0, 13.0, 16.5, 12.0, 34, 25, look_at(np.zeros(3), np.array([0.5, 1.0, -0.7])))
RNG = np.random.default_rng(0)
SHAPE = (CAMERA.height, CAMERA.width)
NODES = np.sort(RNG.integers(0, 4, 50)).astype(np.uint16)
POSES = np.tile(np.eye(4), (4, 1, 1))
POSES[1:, :3, :3] = matrix_from_quaternion(RNG.normal(size=(3, 4)))
POSES[1:, :3, 3] = RNG.normal(0, 5, (3, 3))
PHOTO = RNG.integers(0, 256, (*SHAPE, 3)).astype(np.uint8)
IMAGE = np.clip(PHOTO / 255 + RNG.normal(0, 0.1, PHOTO.shape), -0.1, 1.1)
ALPHA = np.where(RNG.random(SHAPE) < 0.3, 1 - 1e-5, RNG.random(SHAPE))
VALID = RNG.random(SHAPE) < 0.8
PIXELS = np.sort(RNG.choice(SHAPE[0] * SHAPE[1], 60, replace=False)).astype(np.int32)
LIDAR = RNG.uniform(1, 60, 60).astype(np.float32)
POSITION = np.array([1.0, -2, 0.5])
TARGET_MASK = RNG.random(SHAPE) < 0.4


@dataclass(frozen=True)
class Case:
    """One call: what it differentiates by, and the call."""

    inputs: tuple[np.ndarray, ...]
    call: Callable[..., tuple[Tensor, ...]]


def harmonics(rest: int, with_nodes: bool) -> Case:
    arrays = RNG.normal(0, 3, (50, 3)), RNG.normal(0, 1.5, (50, 3)), RNG.normal(0, 0.4, (50, rest, 3))
    nodes = (NODES, POSES) if with_nodes else (None, None)
    return Case(arrays, lambda backend, *inputs: (backend.evaluate_harmonics(*inputs, POSITION, *nodes),))


def photometric(valid: np.ndarray | None, ssim_weight: float) -> Case:
    def call(backend: Backend, image: Tensor) -> tuple[Tensor, ...]:
        loss, psnr = backend.photometric_loss(image, PHOTO, valid, ssim_weight)
        return loss, torch.as_tensor(psnr, dtype=torch.float32)

    return Case((IMAGE,), call)


CASES = {
    "place": Case(
        (RNG.normal(0, 2, (50, 3)), RNG.normal(size=(50, 4)), POSES[:, :3, :3], POSES[:, :3, 3]),
        lambda backend, means, quats, *poses: backend.place_gaussians(means, quats, NODES, *poses),
    ),
    "place in the world": Case(
        (RNG.normal(0, 2, (50, 3)), RNG.normal(size=(50, 4))),
        lambda backend, *inputs: backend.place_gaussians(
            *inputs, np.zeros(50, np.uint16), torch.eye(3)[None], torch.zeros(1, 3)
        ),
    ),
    **{
        f"sh_colors {rest}{' actors' if with_nodes else ''}": harmonics(rest, with_nodes)
        for rest in (0, 3, 8, 15)
        for with_nodes in (False, True)
    },
    **{
        f"over_sky {resolution}": Case(
            (RNG.random((*SHAPE, 3)), ALPHA, RNG.random((6, resolution, resolution, 3))),
            lambda backend, *inputs: (backend.composite_over_sky(*inputs, CAMERA),),
        )
        for resolution in (1, 2, 9)
    },
    "exposed": Case((IMAGE, RNG.normal(size=(3, 4))), lambda backend, *inputs: (backend.expose(*inputs),)),
    "photometric": photometric(None, 0.2),
    "photometric masked": photometric(VALID, 0.2),
    "photometric L1": photometric(VALID, 0.0),
    "photometric SSIM": photometric(None, 1.0),
    "photometric all ego": photometric(np.zeros(SHAPE, bool), 0.2),
    "depth_loss": Case(
        (RNG.uniform(0, 60, SHAPE), ALPHA), lambda backend, *inputs: (backend.depth_loss(*inputs, PIXELS, LIDAR),)
    ),
    "depth_loss nowhere": Case(
        (RNG.uniform(0, 60, SHAPE), ALPHA),
        lambda backend, *inputs: (backend.depth_loss(*inputs, PIXELS[:0], LIDAR[:0]),),
    ),
    "opacity_loss clear": Case((ALPHA,), lambda backend, alpha: (backend.opacity_loss(alpha, TARGET_MASK, False),)),
    "opacity_loss solid": Case((ALPHA,), lambda backend, alpha: (backend.opacity_loss(alpha, TARGET_MASK, True),)),
    "opacity_loss nowhere": Case(
        (ALPHA,), lambda backend, alpha: (backend.opacity_loss(alpha, np.zeros(SHAPE, bool), True),)
    ),
}


def values_and_gradients(case: Case, backend: Backend) -> tuple[list[Tensor], list[Tensor]]:
    """Outputs, and the gradients of their sum under fixed random weights."""
    leaves = [
        torch.tensor(array, dtype=torch.float32, device=backend.device).requires_grad_(True) for array in case.inputs
    ]
    outputs = case.call(backend, *leaves)
    rng, total = np.random.default_rng(1), torch.zeros((), device=backend.device)
    for output in outputs:
        weight = torch.tensor(rng.normal(size=tuple(output.shape)), dtype=torch.float32, device=backend.device)
        total = total + (output.to(backend.device) * weight).sum()
    total.backward()
    gradients = [torch.zeros_like(leaf) if leaf.grad is None else leaf.grad for leaf in leaves]
    return [output.detach().cpu() for output in outputs], [gradient.cpu() for gradient in gradients]


@pytest.mark.parametrize("kind", ["like 1.5", GPU])
@pytest.mark.parametrize("name", CASES)
def test_values_and_gradients_agree(name: str, kind: str) -> None:
    backend = backend_of(kind)
    values, gradients = values_and_gradients(CASES[name], backend)
    expected_values, expected_gradients = values_and_gradients(CASES[name], CpuBackend())
    if name == "place":
        for found in (gradients, expected_gradients):
            found[2] = along_turns(found[2])
    for found, wanted in zip([*values, *gradients], [*expected_values, *expected_gradients], strict=True):
        scale = max(float(wanted.abs().max()) if wanted.numel() else 0.0, 1e-3)
        torch.testing.assert_close(found, wanted, rtol=1e-4, atol=1e-4 * scale)


def along_turns(gradient: Tensor) -> Tensor:
    """What nine free entries say about rotations: two gradients that differ off their tangent mean the same."""
    own = torch.tensor(POSES[:, :3, :3], dtype=torch.float32).transpose(1, 2) @ gradient
    return own - own.transpose(1, 2)
