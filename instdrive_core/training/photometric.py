"""The RGB term (1 - w) L1 + w (1 - SSIM) of 3DGS, value and gradient in one pass of separable windows.

SSIM uses an 11 x 11 Gaussian window (sigma 1.5) with zero padding (Wang et al. 2004). With the windowed moments
m = G*x, s = G*x², p = G*xy, the gradient is G*(∂S/∂m) + 2x·G*(∂S/∂s) + y·G*(∂S/∂p): G is symmetric, hence self-adjoint.
"""

from __future__ import annotations

import numba
import numpy as np
import torch
from jaxtyping import Bool, Float, Float32
from numpy import ndarray
from torch import Tensor

_RADIUS, _SIGMA = 5, 1.5
_C1, _C2 = np.float32(0.01**2), np.float32(0.03**2)
_TAPS = np.exp(-(np.arange(-_RADIUS, _RADIUS + 1) ** 2) / (2 * _SIGMA**2))
_TAPS = (_TAPS / _TAPS.sum()).astype(np.float32)
_FAST = {"nsz", "arcp", "contract", "afn"}


def photometric_loss(
    image: Float[Tensor, "h w 3"],
    target: Float[Tensor, "h w 3"],
    valid: Bool[Tensor, "h w"] | None,
    ssim_weight: float,
) -> Float[Tensor, ""]:
    """(1 - w) L1 + w (1 - SSIM), averaged over the image; the ego vehicle (not valid) adds to neither term."""
    return _Photometric.apply(image, target, valid, ssim_weight)


class _Photometric(torch.autograd.Function):
    @staticmethod
    def forward(ctx, image: Tensor, target: Tensor, valid: Tensor | None, ssim_weight: float) -> Tensor:
        if valid is not None:
            image = torch.where(valid[..., None], image, target)
        x, y = (np.ascontiguousarray(tensor.detach().numpy().transpose(2, 0, 1)) for tensor in (image, target))
        similarity, grad = ssim_and_gradient(x, y)
        grad *= -ssim_weight / x.size
        grad += np.sign(x - y) * np.float32((1 - ssim_weight) / x.size)
        gradient = torch.from_numpy(np.ascontiguousarray(grad.transpose(1, 2, 0)))
        ctx.gradient = gradient if valid is None else gradient * valid[..., None]
        loss = (1 - ssim_weight) * float(np.abs(x - y).mean(dtype=np.float64)) + ssim_weight * (1 - similarity)
        return torch.tensor(loss, dtype=torch.float32)

    @staticmethod
    def backward(ctx, grad: Tensor) -> tuple[Tensor, None, None, None]:
        return ctx.gradient * grad, None, None, None


def ssim_and_gradient(
    x: Float32[ndarray, "c h w"], y: Float32[ndarray, "c h w"]
) -> tuple[float, Float32[ndarray, "c h w"]]:
    """Mean SSIM over pixels and channels, and the gradient of the SSIM map's *sum* with respect to `x`."""
    shape = x.shape
    rows, partials, gradient = np.empty((5, *shape), np.float32), np.empty((3, *shape), np.float32), np.empty_like(x)
    sums = np.zeros(shape[1], np.float64)
    _blur_rows_of_moments(x, y, _TAPS, rows)
    _partials(rows, _TAPS, partials, sums)
    _blur_rows(partials, _TAPS, rows)
    _gradient(rows, x, y, _TAPS, gradient)
    return float(sums.sum() / x.size), gradient


@numba.njit(fastmath=_FAST, error_model="numpy", cache=True)
def _blur_row(padded, taps, out):
    """out[j] = Σ_k taps[k] · padded[j + k]. Unsigned indices need no wraparound test, so the loop vectorises."""
    out[:] = np.float32(0)
    for k in range(np.uint64(len(taps))):
        weight = taps[k]
        for j in range(np.uint64(len(out))):
            out[j] += weight * padded[j + k]


@numba.njit(parallel=True, fastmath=_FAST, error_model="numpy", cache=True)
def _blur_rows_of_moments(x, y, taps, out):
    channels, height, width = x.shape
    for i in numba.prange(height):
        products = np.zeros((5, width + 2 * _RADIUS), np.float32)
        for c in range(channels):
            for j in range(width):
                a, b, k = x[c, i, j], y[c, i, j], j + _RADIUS
                products[0, k], products[1, k] = a, b
                products[2, k], products[3, k], products[4, k] = a * a, b * b, a * b
            for m in range(5):
                _blur_row(products[m], taps, out[m, c, i])


@numba.njit(parallel=True, fastmath=_FAST, error_model="numpy", cache=True)
def _blur_rows(planes, taps, out):
    count, channels, height, width = planes.shape
    for i in numba.prange(height):
        padded = np.zeros(width + 2 * _RADIUS, np.float32)
        for m in range(count):
            for c in range(channels):
                padded[_RADIUS : _RADIUS + width] = planes[m, c, i]
                _blur_row(padded, taps, out[m, c, i])


@numba.njit(fastmath=_FAST, error_model="numpy", cache=True, inline="always")
def _blurred_column(plane, i, taps, out):
    height, width = plane.shape
    out[:] = np.float32(0)
    for k in range(len(taps)):
        source = i + k - _RADIUS
        if 0 <= source < height:
            for j in range(width):
                out[j] += taps[k] * plane[source, j]


@numba.njit(parallel=True, fastmath=_FAST, error_model="numpy", cache=True)
def _partials(rows, taps, partials, sums):
    """Partial derivatives of SSIM by the moments of x: mean, mean square, mean product."""
    _, channels, height, width = rows.shape
    for i in numba.prange(height):
        moments = np.empty((5, width), np.float32)
        total = 0.0
        for c in range(channels):
            for m in range(5):
                _blurred_column(rows[m, c], i, taps, moments[m])
            row_total = np.float32(0)
            for j in range(width):
                mx, my = moments[0, j], moments[1, j]
                a1 = np.float32(2) * mx * my + _C1
                a2 = np.float32(2) * (moments[4, j] - mx * my) + _C2
                b1 = mx * mx + my * my + _C1
                b2 = moments[2, j] - mx * mx + moments[3, j] - my * my + _C2
                inverse = np.float32(1) / (b1 * b2)
                similarity = a1 * a2 * inverse
                by_product = np.float32(2) * a1 * inverse
                by_square = -similarity / b2
                partials[0, c, i, j] = (
                    np.float32(2) * my * a2 * inverse
                    - my * by_product
                    - np.float32(2) * mx * similarity / b1
                    - np.float32(2) * mx * by_square
                )
                partials[1, c, i, j] = by_square
                partials[2, c, i, j] = by_product
                row_total += similarity
            total += row_total
        sums[i] = total


@numba.njit(parallel=True, fastmath=_FAST, error_model="numpy", cache=True)
def _gradient(rows, x, y, taps, gradient):
    channels, height, width = x.shape
    for i in numba.prange(height):
        blurred = np.empty((3, width), np.float32)
        for c in range(channels):
            for m in range(3):
                _blurred_column(rows[m, c], i, taps, blurred[m])
            for j in range(width):
                gradient[c, i, j] = (
                    blurred[0, j] + np.float32(2) * x[c, i, j] * blurred[1, j] + y[c, i, j] * blurred[2, j]
                )
