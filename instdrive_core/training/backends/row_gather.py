"""Rows of a tensor side by side, by all threads: torch copies them with one."""

from __future__ import annotations

import numba
import numpy as np
import torch
from jaxtyping import Float, Int64
from torch import Tensor

_CHUNK = 1 << 10
"""Rows that one thread copies at a time."""


def gather_rows(
    values: Float[Tensor, "n *c"], rows: Int64[Tensor, " v"], by_kernels: bool = True
) -> Float[Tensor, "v *c"]:
    """`values[rows]` without gradient; without `by_kernels` on any device."""
    values = values.detach()
    if not by_kernels:
        return values.index_select(0, rows)
    columns = values[0].numel() if len(values) else 0
    result = np.empty((len(rows), columns), np.float32)
    if columns:
        _gather(values.numpy().reshape(len(values), columns), rows.numpy(), result)
    return torch.from_numpy(result).reshape(len(rows), *values.shape[1:])


@numba.njit(cache=True, parallel=True, error_model="numpy")
def _gather(values, rows, result):
    columns = np.uint64(values.shape[1])
    for chunk in numba.prange((len(rows) + _CHUNK - 1) // _CHUNK):
        for place in range(np.uint64(chunk * _CHUNK), np.uint64(min((chunk + 1) * _CHUNK, len(rows)))):
            row = np.uint64(rows[place])
            for column in range(columns):
                result[place, column] = values[row, column]
