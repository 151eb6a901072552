"""The RGB term (1 - w) L1 + w (1 - SSIM) of 3DGS and its gradient, in three passes of separable windows.

SSIM uses an 11 x 11 Gaussian window G (sigma 1.5) with zero padding (Wang et al. 2004). It is computed from the
total u = x + y and the difference v = x - y of image and target: with windowed variances U and V of u and v,
2σ_xy = (U - V) / 2 and σ_x² + σ_y² = (U + V) / 2, so four moments do. The gradient with respect to x is
G*(∂S/∂m_u + ∂S/∂m_v) + 2u·G*(∂S/∂s_u) + 2v·G*(∂S/∂s_v), with m = G*u and s = G*u²: G is its own adjoint.

Images stay as they lie in memory, colours interleaved: a window over pixels takes every third number of a row.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, Float64, UInt8
from numpy import ndarray
from torch import Tensor
from torch.autograd.function import once_differentiable

from instdrive_core.rasterize.kernels.layout import to_kernel_array

_RADIUS, _SIGMA = 5, 1.5
_WEIGHTS = np.exp(-(np.arange(-_RADIUS, _RADIUS + 1) ** 2) / (2 * _SIGMA**2))
_TAPS = (_WEIGHTS / _WEIGHTS.sum()).astype(np.float32)
"""A constant of the kernels, so that the loops over it are unrolled: ten times faster than an argument."""
_WINDOW = np.uint64(2 * _RADIUS + 1)
_COLORS = np.uint64(3)
_MARGIN = 3 * _RADIUS
"""Numbers left and right of a row that its windows reach."""
_FROM_BYTE = np.float32(1 / 255)
_C1, _C2 = np.float32(0.01**2), np.float32(0.03**2)
_FAST = {"nsz", "arcp", "contract", "afn", "reassoc"}
"""With reassoc, sums along a row vectorise; their order is the compiler's, and the same in every run."""

# Columns of a row's sums.
_ABSOLUTE, _SQUARED, _DISSIMILAR = range(3)


@dataclass(frozen=True)
class _Comparison:
    """Results of the forward pass that the gradient needs; rows are w·3 numbers wide."""

    total: Float32[ndarray, "h+10 w*3"]
    """Image plus target, between rows of zeros; invalid pixels count as equal to the target."""
    difference: Float32[ndarray, "h+10 w*3"]
    """Image minus target, the same way."""
    partials: Float32[ndarray, "3 h+10 w*3"]
    """The derivatives of Σ (1 - SSIM) by the moments, blurred along the rows, between rows of zeros."""
    mask: Bool[ndarray, "h w"]
    """The valid pixels, or empty where all are."""


def photometric_loss(
    image: Float[Tensor, "h w 3"],
    target: UInt8[ndarray, "h w 3"],
    valid: Bool[ndarray, "h w"] | None,
    ssim_weight: float,
) -> tuple[Float[Tensor, ""], float]:
    """(1 - w) L1 + w (1 - SSIM), averaged over the image, and the PSNR in dB of the image clamped to [0, 1].

    Args:
        target: 0 … 255.
        valid: False on the ego vehicle, where the image counts as equal to the target: it adds to neither term and
            gets no gradient. The PSNR is that of the valid pixels.
    """
    return _Photometric.apply(image, target, valid, ssim_weight)


class _Photometric(torch.autograd.Function):
    @staticmethod
    def forward(ctx, image, target, valid, ssim_weight):
        compared, sums = _compare(image.detach().numpy(), target, valid)
        absolute, squared, dissimilar = sums
        loss = ((1 - ssim_weight) * absolute + ssim_weight * dissimilar) / image.numel()
        ctx.compared, ctx.weight, ctx.shape = compared, ssim_weight, tuple(image.shape)
        count = image.numel() if valid is None else 3 * np.count_nonzero(valid)
        psnr = -10 * np.log10(max(squared / max(count, 1), 1e-10))
        return torch.tensor(loss, dtype=torch.float32), float(psnr)

    @staticmethod
    @once_differentiable
    def backward(ctx, grad_loss, _):  # pyright: ignore[reportIncompatibleMethodOverride]
        compared, gradient = ctx.compared, np.empty(ctx.shape, np.float32)
        scale = float(grad_loss) / gradient.size
        scales = np.float32(scale * (1 - ctx.weight)), np.float32(scale * ctx.weight)
        rows = gradient.reshape(len(gradient), -1)
        _gradient(compared.partials, compared.total, compared.difference, compared.mask, *scales, rows)
        return torch.from_numpy(gradient), None, None, None


def _compare(image: ndarray, target: ndarray, valid: ndarray | None) -> tuple[_Comparison, Float64[ndarray, "3"]]:
    """The forward pass, and the image's sums of absolute errors, squared errors and 1 - SSIM."""
    height, width, _ = image.shape
    padded = (height + 2 * _RADIUS, 3 * width)
    compared = _Comparison(
        total=np.empty(padded, np.float32),
        difference=np.empty(padded, np.float32),
        partials=np.empty((3, *padded), np.float32),
        mask=np.empty((0, 0), np.bool_) if valid is None else np.require(valid, np.bool_, ["C", "W"]),
    )
    sums = np.empty((height, 3), np.float64)
    wanted = np.require(target, np.uint8, ["C", "W"]).reshape(height, -1)
    rows = (to_kernel_array(image).reshape(height, -1), wanted)
    _totals_and_differences(*rows, compared.mask, compared.total, compared.difference, sums)
    _partials_by_moments(compared.total, compared.difference, compared.partials, sums)
    return compared, sums.sum(axis=0)


@numba.njit(fastmath=_FAST, error_model="numpy", cache=True)
def _compare_row(image, target, total, difference):
    for j in range(np.uint64(len(image))):
        y = np.float32(target[j]) * _FROM_BYTE
        total[j], difference[j] = image[j] + y, image[j] - y


@numba.njit(fastmath=_FAST, error_model="numpy", cache=True)
def _equalize_invalid(valid, total, difference):
    for column in range(len(valid)):
        if not valid[column]:
            for j in range(3 * column, 3 * column + 3):
                total[j], difference[j] = total[j] - difference[j], np.float32(0)


@numba.njit(fastmath=_FAST, error_model="numpy", cache=True)
def _row_errors(total, difference):
    """Sums of absolute errors, and of squared errors of the image clamped to [0, 1]."""
    absolute, squared, half = np.float32(0), np.float32(0), np.float32(0.5)
    for j in range(np.uint64(len(total))):
        x, y = half * (total[j] + difference[j]), half * (total[j] - difference[j])
        error = min(max(x, np.float32(0)), np.float32(1)) - y
        absolute += abs(difference[j])
        squared += error * error
    return absolute, squared


@numba.njit(parallel=True, fastmath=_FAST, error_model="numpy", cache=True)
def _totals_and_differences(image, target, mask, total, difference, sums):
    height = len(image)
    for i in numba.prange(height + 2 * _RADIUS):
        row = i - _RADIUS
        if row < 0 or row >= height:
            total[i], difference[i] = 0, 0
            continue
        _compare_row(image[row], target[row], total[i], difference[i])
        if mask.size:
            _equalize_invalid(mask[row], total[i], difference[i])
        sums[row, _ABSOLUTE], sums[row, _SQUARED] = _row_errors(total[i], difference[i])


@numba.njit(fastmath=_FAST, error_model="numpy", cache=True)
def _moments_down(total, difference, first, moments):
    """Means and mean squares of u and v over the windows of one row, down the columns only."""
    for j in range(np.uint64(total.shape[1])):
        mean_u = mean_v = square_u = square_v = np.float32(0)
        for k in range(_WINDOW):
            u, v = total[first + k, j], difference[first + k, j]
            weighted_u, weighted_v = _TAPS[k] * u, _TAPS[k] * v
            mean_u += weighted_u
            mean_v += weighted_v
            square_u += weighted_u * u
            square_v += weighted_v * v
        at = j + np.uint64(_MARGIN)
        moments[0, at], moments[1, at], moments[2, at], moments[3, at] = mean_u, mean_v, square_u, square_v


@numba.njit(fastmath=_FAST, error_model="numpy", cache=True)
def _blur_along(padded, out):
    for j in range(np.uint64(len(out))):
        blurred = np.float32(0)
        for k in range(_WINDOW):
            blurred += _TAPS[k] * padded[j + _COLORS * k]
        out[j] = blurred


@numba.njit(fastmath=_FAST, error_model="numpy", cache=True)
def _row_partials(moments, partials):
    """1 - SSIM of a row into `moments[0]`; its derivatives by the means (their sum) and by either mean square."""
    one, two, half = np.float32(1), np.float32(2), np.float32(0.5)
    for j in range(np.uint64(moments.shape[1])):
        mu, mv = moments[0, j], moments[1, j]
        squared_u, squared_v = mu * mu, mv * mv
        variance_u, variance_v = moments[2, j] - squared_u, moments[3, j] - squared_v
        a1, b1 = half * (squared_u - squared_v) + _C1, half * (squared_u + squared_v) + _C1
        a2, b2 = half * (variance_u - variance_v) + _C2, half * (variance_u + variance_v) + _C2
        inverse = one / (b1 * b2)
        similarity = a1 * a2 * inverse
        by_a1, by_a2 = a2 * inverse, a1 * inverse
        by_b1, by_b2 = similarity * inverse * b2, similarity * inverse * b1
        by_square_u, by_square_v = half * (by_b2 - by_a2), half * (by_b2 + by_a2)
        moments[0, j] = one - similarity
        at = j + np.uint64(_MARGIN)
        partials[0, at] = mu * (by_b1 - by_a1 - two * by_square_u) + mv * (by_b1 + by_a1 - two * by_square_v)
        partials[1, at], partials[2, at] = by_square_u, by_square_v


@numba.njit(fastmath=_FAST, error_model="numpy", cache=True)
def _row_sum(row):
    total = np.float32(0)
    for j in range(np.uint64(len(row))):
        total += row[j]
    return total


@numba.njit(parallel=True, fastmath=_FAST, error_model="numpy", cache=True)
def _partials_by_moments(total, difference, partials, sums):
    height, width = total.shape[0] - 2 * _RADIUS, total.shape[1]
    for i in numba.prange(height + 2 * _RADIUS):
        row = i - _RADIUS
        if row < 0 or row >= height:
            partials[:, i] = 0
            continue
        down, moments = np.zeros((4, width + 2 * _MARGIN), np.float32), np.empty((4, width), np.float32)
        local = np.zeros((3, width + 2 * _MARGIN), np.float32)
        _moments_down(total, difference, np.uint64(row), down)
        for m in range(4):
            _blur_along(down[m], moments[m])
        _row_partials(moments, local)
        sums[row, _DISSIMILAR] = _row_sum(moments[0])
        for m in range(3):
            _blur_along(local[m], partials[m, i])


@numba.njit(fastmath=_FAST, error_model="numpy", cache=True)
def _gradient_of_row(partials, total, difference, first, l1_scale, ssim_scale, out):
    two, zero, at = np.float32(2), np.float32(0), first + np.uint64(_RADIUS)
    for j in range(np.uint64(len(out))):
        by_means = by_square_u = by_square_v = zero
        for k in range(_WINDOW):
            by_means += _TAPS[k] * partials[0, first + k, j]
            by_square_u += _TAPS[k] * partials[1, first + k, j]
            by_square_v += _TAPS[k] * partials[2, first + k, j]
        u, v = total[at, j], difference[at, j]
        sign = l1_scale if v > zero else (-l1_scale if v < zero else zero)
        out[j] = sign + ssim_scale * (by_means + two * (u * by_square_u + v * by_square_v))


@numba.njit(fastmath=_FAST, error_model="numpy", cache=True)
def _clear_invalid(valid, out):
    for column in range(len(valid)):
        if not valid[column]:
            for j in range(3 * column, 3 * column + 3):
                out[j] = 0


@numba.njit(parallel=True, fastmath=_FAST, error_model="numpy", cache=True)
def _gradient(partials, total, difference, mask, l1_scale, ssim_scale, out):
    for i in numba.prange(len(out)):
        _gradient_of_row(partials, total, difference, np.uint64(i), l1_scale, ssim_scale, out[i])
        if mask.size:
            _clear_invalid(mask[i], out[i])
