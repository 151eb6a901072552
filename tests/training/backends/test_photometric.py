"""The RGB term against scikit-image, a plain torch version and finite differences."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from numpy import ndarray
from skimage.metrics import structural_similarity
from torch import Tensor

from instdrive_core.training.backends.photometric import photometric_loss


def pair(height: int = 26, width: int = 37, seed: int = 0) -> tuple[Tensor, ndarray]:
    """An image and the bytes of one much like it."""
    rng = np.random.default_rng(seed)
    target = rng.integers(0, 256, (height, width, 3)).astype(np.uint8)
    image = np.clip(target / 255 + rng.normal(0, 0.1, target.shape), -0.1, 1.1)
    return torch.tensor(image, dtype=torch.float32, requires_grad=True), target


def some_valid(height: int = 26, width: int = 37) -> ndarray:
    valid = np.ones((height, width), bool)
    valid[20:, 5:] = False
    valid[3, 4] = False
    return valid


def plain_loss(image: Tensor, target: ndarray, valid: ndarray | None, weight: float) -> Tensor:
    """In double precision, with convolutions."""
    wanted = torch.from_numpy(target).double() / 255
    x = image.double()
    if valid is not None:
        x = torch.where(torch.from_numpy(valid)[..., None], x, wanted)
    taps = torch.exp(-(torch.arange(-5, 6).double() ** 2) / (2 * 1.5**2))
    window = torch.outer(taps, taps)[None, None] / taps.sum() ** 2

    def blurred(planes: Tensor) -> Tensor:
        return F.conv2d(planes.permute(2, 0, 1)[:, None], window, padding=5)[:, 0]

    mx, my = blurred(x), blurred(wanted)
    xx, yy, xy = blurred(x * x) - mx * mx, blurred(wanted * wanted) - my * my, blurred(x * wanted) - mx * my
    c1, c2 = 0.01**2, 0.03**2
    ssim = (2 * mx * my + c1) * (2 * xy + c2) / ((mx * mx + my * my + c1) * (xx + yy + c2))
    return (1 - weight) * (x - wanted).abs().mean() + weight * (1 - ssim.mean())


def test_ssim_equals_scikit_image_on_zero_padded_images() -> None:
    image, target = pair()
    padded = [np.pad(array, ((12, 12), (12, 12), (0, 0))) for array in (image.detach().numpy(), target / 255)]
    _, theirs = structural_similarity(
        *padded,
        channel_axis=2,
        data_range=1.0,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        full=True,
    )
    loss, _ = photometric_loss(image, target, None, 1.0)
    assert 1 - float(loss.detach()) == pytest.approx(theirs[12:-12, 12:-12].mean(), abs=1e-5)


@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize("weight", [0.0, 0.2, 1.0])
def test_value_and_gradient_are_those_of_plain_torch(weight: float, masked: bool) -> None:
    image, target = pair()
    valid = some_valid() if masked else None
    loss, _ = photometric_loss(image, target, valid, weight)
    (found,) = torch.autograd.grad(3 * loss, image)
    expected = plain_loss(image, target, valid, weight)
    (wanted,) = torch.autograd.grad(3 * expected, image)
    assert float(loss.detach()) == pytest.approx(float(expected.detach()), rel=1e-5)
    np.testing.assert_allclose(found, wanted, atol=1e-4 * float(wanted.abs().max()))


def test_bright_flat_regions_keep_their_precision() -> None:
    rng = np.random.default_rng(3)
    target = np.full((40, 40, 3), 250, np.uint8)
    image = torch.tensor(250 / 255 + rng.normal(0, 3e-3, (40, 40, 3)), dtype=torch.float32, requires_grad=True)
    loss, _ = photometric_loss(image, target, None, 1.0)
    expected = plain_loss(image, target, None, 1.0)
    (found,), (wanted,) = torch.autograd.grad(loss, image), torch.autograd.grad(expected, image)
    assert float(loss.detach()) == pytest.approx(float(expected.detach()), rel=2e-3)
    np.testing.assert_allclose(found, wanted, atol=1e-2 * float(wanted.abs().max()))


def test_gradient_is_that_of_finite_differences() -> None:
    image, target = pair(14, 17)
    loss, _ = photometric_loss(image, target, None, 1.0)  # differences would cross the kinks of the L1 term
    loss.backward()
    direction, step = torch.randn(image.shape, generator=torch.Generator().manual_seed(0)), 1e-3
    with torch.no_grad():
        plus, minus = (photometric_loss(image + s * direction, target, None, 1.0)[0] for s in (step, -step))
    assert float((image.grad * direction).sum()) == pytest.approx(float(plus - minus) / (2 * step), rel=0.02)


def test_the_ego_vehicle_counts_in_neither_value_nor_gradient() -> None:
    image, target = pair()
    valid = some_valid()
    first, first_psnr = photometric_loss(image, target, valid, 0.2)
    first.backward()
    assert not image.grad.numpy()[~valid].any()
    with torch.no_grad():
        image[torch.from_numpy(~valid)] = 7
    second, second_psnr = photometric_loss(image, target, valid, 0.2)
    assert float(second.detach()) == float(first.detach())
    assert second_psnr == first_psnr


@pytest.mark.parametrize("masked", [False, True])
def test_psnr_is_that_of_the_clamped_image_over_valid_pixels(masked: bool) -> None:
    image, target = pair()
    valid = some_valid() if masked else None
    squared = (np.clip(image.detach().numpy(), 0, 1) - target / 255) ** 2
    expected = -10 * np.log10(squared[slice(None) if valid is None else valid].mean())
    assert photometric_loss(image, target, valid, 0.2)[1] == pytest.approx(expected, abs=1e-4)


def test_equal_images_cost_nothing() -> None:
    _, target = pair(16, 16)
    image = torch.from_numpy(target).float() / 255
    loss, psnr = photometric_loss(image, target, None, 0.2)
    assert float(loss) == pytest.approx(0, abs=1e-6)
    assert psnr == pytest.approx(100)
    loss, _ = photometric_loss(torch.zeros(16, 16, 3), target, np.zeros((16, 16), bool), 0.2)
    assert float(loss) == pytest.approx(0, abs=1e-6)
