"""A photo's exposure, an affine change of colour, on the CPU: one pass over the image, one back."""

from __future__ import annotations

import numba
import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from instdrive_core.rasterize.kernels.layout import to_kernel_array

_FAST = {"nsz", "arcp", "contract", "afn", "reassoc"}


def expose(image: Float[Tensor, "h w 3"], exposure: Float[Tensor, "3 4"]) -> Float[Tensor, "h w 3"]:
    """exposure[:, :3] · colour + exposure[:, 3] at every pixel, with gradients to both."""
    return _Exposed.apply(image, exposure)


class _Exposed(torch.autograd.Function):
    @staticmethod
    def forward(ctx, image, exposure):
        ctx.save_for_backward(image, exposure)
        result = np.empty(tuple(image.shape), np.float32)
        _expose(to_kernel_array(image.detach().numpy()), to_kernel_array(exposure.detach().numpy()), result)
        return torch.from_numpy(result)

    @staticmethod
    @once_differentiable
    def backward(ctx, grad):  # pyright: ignore[reportIncompatibleMethodOverride]
        image, exposure = (to_kernel_array(tensor.detach().numpy()) for tensor in ctx.saved_tensors)
        grad_image, row_sums = np.empty(image.shape, np.float32), np.empty((len(image), 12), np.float64)
        _expose_backward(to_kernel_array(grad.numpy()), image, exposure, grad_image, row_sums)
        grad_exposure = row_sums.sum(axis=0).reshape(3, 4).astype(np.float32)
        return torch.from_numpy(grad_image), torch.from_numpy(grad_exposure)


@numba.njit(parallel=True, fastmath=_FAST, error_model="numpy", cache=True)
def _expose(image, exposure, result):
    for row in numba.prange(len(image)):
        for column in range(np.uint64(image.shape[1])):
            red, green, blue = image[row, column, 0], image[row, column, 1], image[row, column, 2]
            for c in range(3):
                result[row, column, c] = (
                    exposure[c, 0] * red + exposure[c, 1] * green + exposure[c, 2] * blue + exposure[c, 3]
                )


@numba.njit(fastmath=_FAST, error_model="numpy", cache=True)
def _products_of_row(grad, image, channel, sums):
    """Sums over a row of one channel's gradient times red, green, blue and one."""
    red = green = blue = one = np.float32(0)
    for column in range(np.uint64(len(image))):
        value = grad[column, channel]
        red += value * image[column, 0]
        green += value * image[column, 1]
        blue += value * image[column, 2]
        one += value
    sums[4 * channel], sums[4 * channel + 1], sums[4 * channel + 2], sums[4 * channel + 3] = red, green, blue, one


@numba.njit(parallel=True, fastmath=_FAST, error_model="numpy", cache=True)
def _expose_backward(grad, image, exposure, grad_image, row_sums):
    for row in numba.prange(len(image)):
        for column in range(np.uint64(image.shape[1])):
            red, green, blue = grad[row, column, 0], grad[row, column, 1], grad[row, column, 2]
            for c in range(3):
                grad_image[row, column, c] = exposure[0, c] * red + exposure[1, c] * green + exposure[2, c] * blue
        for channel in range(3):
            _products_of_row(grad[row], image[row], channel, row_sums[row])
