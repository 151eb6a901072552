"""The torch side of the rasterizer: values and gradients are those of the numpy functions, nothing is lost between."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from instdrive_core.maths.activations import sigmoid
from instdrive_core.rasterize.kernels.view_colors import build_harmonics_view, compute_colors, compute_colors_backward
from instdrive_core.rasterize.render import render, render_backward
from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.training.backends.autograd import evaluate_harmonics, rasterize
from instdrive_core.training.backends.backend import SeenSplats

CAMERA = Camera(40.0, 42.0, 23.0, 16.0, 47, 33, look_at(np.array([0.0, -4, 1]), np.array([0.0, 0, 0])))
NAMES = ("means", "quats", "log_scales", "logits", "channels")


def parameters(count: int = 60, channels: int = 6) -> dict[str, torch.Tensor]:
    rng = np.random.default_rng(0)
    arrays = {
        "means": rng.uniform(-1.2, 1.2, (count, 3)),
        "quats": rng.normal(size=(count, 4)),
        "log_scales": rng.normal(-1.8, 0.4, (count, 3)),
        "logits": rng.normal(0, 1.5, count),
        "channels": rng.uniform(-1, 1, (count, channels)),
    }
    return {name: torch.tensor(array, dtype=torch.float32, requires_grad=True) for name, array in arrays.items()}


def test_values_and_gradients_are_those_of_the_numpy_functions() -> None:
    p = parameters()
    image, depth, alpha = rasterize(*(p[name] for name in NAMES), CAMERA, 3)
    arrays = {name: value.detach().numpy() for name, value in p.items()}
    opacities = sigmoid(arrays["logits"])
    raster = render(arrays["means"], arrays["quats"], arrays["log_scales"], opacities, arrays["channels"], CAMERA)
    np.testing.assert_allclose(image.detach().numpy(), raster.image, atol=1e-6)
    np.testing.assert_allclose(depth.detach().numpy(), raster.depth, atol=1e-5)
    np.testing.assert_allclose(alpha.detach().numpy(), raster.alpha, atol=1e-6)

    (image.square().sum() + 0.1 * depth.square().sum() + alpha.sum()).backward()
    expected = render_backward(raster.context, 2 * raster.image, 0.2 * raster.depth, np.ones_like(raster.alpha), 3)
    for name in ("means", "quats", "log_scales", "channels"):
        found, wanted = p[name].grad.numpy(), getattr(expected, name)
        np.testing.assert_allclose(found, wanted, rtol=1e-3, atol=1e-4 * np.abs(wanted).max())
    by_logit = expected.opacities * opacities * (1 - opacities)
    np.testing.assert_allclose(p["logits"].grad.numpy(), by_logit, rtol=1e-3, atol=1e-4 * np.abs(by_logit).max())


def test_an_output_that_the_loss_ignores_is_no_obstacle() -> None:
    p = parameters()
    _, depth, _ = rasterize(*(p[name] for name in NAMES), CAMERA, 3)
    depth.sum().backward()
    assert p["means"].grad.abs().sum() > 0
    assert not p["channels"].grad.any()


def test_descending_the_gradient_fits_a_picture() -> None:
    p = parameters(channels=3)
    target = torch.from_numpy(np.random.default_rng(1).uniform(0, 1, (3,)).astype(np.float32)).expand(33, 47, 3)
    optimizer = torch.optim.Adam(list(p.values()), lr=0.05)
    losses = []
    for _ in range(40):
        image, _, _ = rasterize(*(p[name] for name in NAMES), CAMERA, 3)
        loss = (image - target).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    assert losses[-1] < 0.2 * losses[0]


def test_changes_between_the_passes_are_noticed() -> None:
    p = parameters()
    image, _, _ = rasterize(*(p[name] for name in NAMES), CAMERA, 3)
    with torch.no_grad():
        p["means"].add_(1)
    with pytest.raises(RuntimeError, match="modified by an inplace operation"):
        image.sum().backward()


def test_what_a_view_has_seen_is_in_shares_of_the_image() -> None:
    p = parameters()
    with torch.no_grad():
        p["means"][7] = torch.tensor([0.0, -9.0, 0.0])  # behind the camera
    seen = SeenSplats()
    image, _, _ = rasterize(*(p[name] for name in NAMES), CAMERA, 3, seen)
    assert seen.visible is None
    image.sum().backward()
    arrays = [p[name].detach().numpy() for name in NAMES]
    arrays[3] = sigmoid(arrays[3])
    raster = render(*arrays, CAMERA)
    zero = np.zeros_like(raster.depth)
    expected = render_backward(raster.context, np.ones_like(raster.image), zero, zero, 3)
    np.testing.assert_array_equal(seen.visible, expected.visible)
    np.testing.assert_allclose(seen.gradients, expected.means2d_abs * 47 / 2, rtol=1e-3)
    assert not seen.visible[7]
    assert seen.gradients[7] == 0


def test_extreme_logits_stay_finite() -> None:
    p = parameters()
    with torch.no_grad():
        p["logits"][:20], p["logits"][20:40] = -200, 200
    image, _, _ = rasterize(*(p[name] for name in NAMES), CAMERA, 3)
    image.sum().backward()
    assert all(bool(tensor.grad.isfinite().all()) for tensor in p.values())
    assert not p["logits"].grad[:40].any()


def test_harmonics_send_their_gradient_to_the_coefficients_only() -> None:
    rng = np.random.default_rng(2)
    means, sh_dc, sh_rest = (
        torch.tensor(rng.normal(size=shape), dtype=torch.float32, requires_grad=True)
        for shape in ((30, 3), (30, 3), (30, 8, 3))
    )
    colors = evaluate_harmonics(means, sh_dc, sh_rest, CAMERA.position)
    arrays = [tensor.detach().numpy() for tensor in (means, sh_dc, sh_rest)]
    np.testing.assert_array_equal(colors.detach().numpy(), compute_colors(*arrays, CAMERA.position))
    weights = torch.tensor(rng.normal(size=(30, 3)), dtype=torch.float32)
    (colors * weights).sum().backward()
    view = build_harmonics_view(arrays[0], CAMERA.position)
    grad_dc, grad_rest = compute_colors_backward(view, 8, colors.detach().numpy(), weights.numpy())
    np.testing.assert_array_equal(sh_dc.grad.numpy(), grad_dc)
    np.testing.assert_array_equal(sh_rest.grad.numpy(), grad_rest)
    assert means.grad is None
