"""The affine change of colour against plain torch."""

from __future__ import annotations

import numpy as np
import torch

from instdrive_core.training.backends.exposure_op import expose


def test_value_and_gradients_are_those_of_plain_torch() -> None:
    generator = torch.Generator().manual_seed(0)
    image = torch.rand(31, 45, 3, generator=generator).requires_grad_(True)
    exposure = (torch.eye(3, 4) + 0.2 * torch.randn(3, 4, generator=generator)).requires_grad_(True)
    weights = torch.randn(31, 45, 3, generator=generator)
    found, expected = expose(image, exposure), image @ exposure[:, :3].T + exposure[:, 3]
    np.testing.assert_allclose(found.detach(), expected.detach(), atol=1e-6)
    grads = torch.autograd.grad((found * weights).sum(), (image, exposure))
    for grad, wanted in zip(grads, torch.autograd.grad((expected * weights).sum(), (image, exposure)), strict=True):
        np.testing.assert_allclose(grad, wanted, rtol=1e-4, atol=1e-5)


def test_the_identity_changes_nothing() -> None:
    image = torch.rand(8, 9, 3)
    np.testing.assert_array_equal(expose(image, torch.eye(3, 4)), image)
