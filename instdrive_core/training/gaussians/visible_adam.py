"""Adam for per-Gaussian parameters that touches only the rows one view has seen.

Adam: Kingma & Ba 2015. Rows without a gradient keep values and moments, as in 3DGS's "sparse Adam"; beyond that,
every row has its own count of updates, so that a Gaussian born late takes well-sized first steps.
"""

from __future__ import annotations

import math
from typing import no_type_check

import numba
import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, Int64
from numpy import ndarray
from torch import Tensor

from instdrive_core.rasterize.kernels.layout import to_kernel_array

_FIRST, _SECOND, _STEPS = "first.", "second.", "steps"
_FLAGS = {"nsz", "arcp", "contract", "afn"}
"""fastmath without nnan and ninf: a gradient that is not finite must show in the parameters."""


class VisibleAdam:
    """Adam on tensors that all have one row per Gaussian; `step` updates the rows it is given and no others.

    The count of updates belongs to the row, not to the parameter: a parameter that first gets gradients long after the
    others wants an optimiser of its own.
    """

    def __init__(
        self,
        parameters: dict[str, Tensor],
        rates: dict[str, float],
        betas: tuple[float, float] = (0.9, 0.999),
        eps: float = 1e-15,
        by_kernels: bool = True,
    ) -> None:
        """
        Args:
            parameters: float32 leaf tensors (n, …), contiguous, all on one device; written in place.
            rates: the learning rate of each; may be changed between steps.
            by_kernels: on Numba's kernels, for parameters on the CPU; else in plain torch, on any device.

        Raises:
            ValueError: for a parameter without a rate, of another length, or of another layout.
        """
        count = {name: len(value) for name, value in parameters.items()}
        if len(set(count.values())) != 1:
            raise ValueError(f"parameters must have one length, got {count}")
        for name, value in parameters.items():
            if name not in rates:
                raise ValueError(f"{name} has no learning rate")
            if value.dtype != torch.float32 or not value.is_contiguous():
                raise ValueError(f"{name} must be contiguous float32, got {value.dtype} with strides {value.stride()}")
        self.parameters = dict(parameters)
        self.rates = dict(rates)
        self.betas, self.eps, self.by_kernels = betas, eps, by_kernels
        self.first = {name: torch.zeros_like(value, requires_grad=False) for name, value in parameters.items()}
        """Running mean of the gradients, by name."""
        self.second = {name: torch.zeros_like(value, requires_grad=False) for name, value in parameters.items()}
        """Running mean of the squared gradients, by name."""
        device = next(iter(parameters.values())).device
        self.steps = torch.zeros(next(iter(count.values())), dtype=torch.int32, device=device)
        """How often each row was updated."""
        self._corrections = torch.from_numpy(_bias_corrections(betas)).to(device)

    def step(
        self,
        rows: Int64[Tensor, " v"] | Int64[ndarray, " v"],
        gradients: dict[str, Float[Tensor, "v ..."] | None],
        visible: Bool[Tensor, " v"] | None = None,
    ) -> None:
        """Update `rows[visible]` (all of `rows` by default) by their gradients.

        Args:
            rows: distinct rows of the parameters.
            gradients: by name, one row for each of `rows`; parameters that are left out or None stay as they are.
        """
        used = {name: g for name, g in gradients.items() if g is not None and g.numel()}
        if not used:
            return
        if self.by_kernels:
            self._step_by_kernels(rows, used, visible)
        else:
            self._step_by_indexing(rows, used, visible)

    def _step_by_kernels(self, rows: Tensor | ndarray, gradients: dict[str, Tensor], visible: Tensor | None) -> None:
        places = np.require(np.asarray(rows), np.int64, ["C", "W"])
        seen = np.ones(len(places), np.bool_) if visible is None else np.require(visible.numpy(), None, ["C", "W"])
        steps, corrections = self.steps.numpy(), self._corrections.numpy()
        for name, gradient in gradients.items():
            constants = np.array([self.rates[name], *self.betas, self.eps], np.float64)
            state = (self.parameters[name], self.first[name], self.second[name])
            values, first, second = (_flat_rows(tensor.detach().numpy()) for tensor in state)
            changes = _flat_rows(to_kernel_array(gradient.detach().numpy()))
            _update(values, first, second, changes, places, seen, steps, corrections, constants)
        _count(places, seen, steps)

    @torch.no_grad()
    def _step_by_indexing(self, rows: Tensor | ndarray, gradients: dict[str, Tensor], visible: Tensor | None) -> None:
        places = torch.as_tensor(rows, device=self.steps.device)
        # Rows that are not visible get what they have: to leave them out, their number had to be read from the device.
        seen = torch.ones_like(places, dtype=torch.bool) if visible is None else visible
        self.steps.index_add_(0, places, seen.int())
        corrections = self._corrections[self.steps[places].long().clamp(max=len(self._corrections) - 1)]
        (b1, b2), eps = self.betas, self.eps
        for name, change in gradients.items():
            by_row = (-1, *[1] * (change.dim() - 1))
            kept, old_first, old_second = seen.view(by_row), self.first[name][places], self.second[name][places]
            first = torch.where(kept, b1 * old_first + (1 - b1) * change, old_first)
            second = torch.where(kept, b2 * old_second + (1 - b2) * change * change, old_second)
            scale = second.sqrt() * corrections[:, 1].view(by_row) + eps
            move = self.rates[name] * corrections[:, 0].view(by_row) * first / scale
            self.first[name][places], self.second[name][places] = first, second
            self.parameters[name][places] -= torch.where(kept, move, 0)

    def rearrange(
        self,
        parents: Int64[Tensor, " m"] | Int64[ndarray, " m"],
        fresh: Bool[Tensor, " m"] | Bool[ndarray, " m"],
        parameters: dict[str, Tensor],
    ) -> VisibleAdam:
        """Build the optimiser of `parameters`, whose row i comes from row `parents[i]` of these.

        Moments and counts come along; they are zero where `fresh`.
        """
        device = self.steps.device
        old, born = torch.as_tensor(parents, device=device), torch.as_tensor(fresh, device=device)
        result = VisibleAdam(parameters, self.rates, self.betas, self.eps, self.by_kernels)
        for theirs, mine in ((result.first, self.first), (result.second, self.second)):
            for name, moments in mine.items():
                theirs[name] = moments[old]
                theirs[name][born] = 0
        result.steps = self.steps[old]
        result.steps[born] = 0
        return result

    def state_tensors(self) -> dict[str, Tensor]:
        """Tensors that a checkpoint needs beside the parameters: moments and counts, not copied."""
        first = {_FIRST + name: value for name, value in self.first.items()}
        second = {_SECOND + name: value for name, value in self.second.items()}
        return {**first, **second, _STEPS: self.steps}

    def load_state_tensors(self, tensors: dict[str, Tensor]) -> None:
        """Take over what `state_tensors` gave, by value. Raises ValueError where a tensor is missing or misfits."""
        for name, mine in self.state_tensors().items():
            theirs = tensors.get(name)
            if theirs is None or theirs.shape != mine.shape or theirs.dtype != mine.dtype:
                found = "nothing" if theirs is None else f"{theirs.dtype} {tuple(theirs.shape)}"
                raise ValueError(f"optimiser state {name}: expected {mine.dtype} {tuple(mine.shape)}, found {found}")
            mine.copy_(theirs)


def _bias_corrections(betas: tuple[float, float]) -> Float32[ndarray, "t 2"]:
    """1 / (1 - β₁ᵗ) and 1 / √(1 - β₂ᵗ) by the number of updates t, up to where both are 1 in float32."""
    last = math.ceil(math.log(2.0**-25) / math.log(max(*betas, 0.5)))
    t = np.arange(last + 1, dtype=np.float64)
    t[0] = 1  # never looked up: a row that is being updated has been updated once
    return np.stack([1 / (1 - betas[0] ** t), 1 / np.sqrt(1 - betas[1] ** t)], axis=1).astype(np.float32)


def _flat_rows(array: ndarray) -> Float32[ndarray, "n c"]:
    return array.reshape(len(array), math.prod(array.shape[1:]))


@numba.njit(cache=True, parallel=True, error_model="numpy", fastmath=_FLAGS)
@no_type_check
def _update(values, first, second, gradients, rows, visible, steps, corrections, constants):
    rate, b1, b2 = np.float32(constants[0]), np.float32(constants[1]), np.float32(constants[2])
    c1, c2, eps = np.float32(1 - constants[1]), np.float32(1 - constants[2]), np.float32(constants[3])
    last = len(corrections) - 1
    for k in numba.prange(len(rows)):
        if not visible[k]:
            continue
        row = rows[k]
        t = min(steps[row] + 1, last)
        size, spread = rate * corrections[t, 0], corrections[t, 1]
        for c in range(values.shape[1]):
            g = gradients[k, c]
            m = b1 * first[row, c] + c1 * g
            v = b2 * second[row, c] + c2 * g * g
            first[row, c], second[row, c] = m, v
            values[row, c] -= size * m / (np.sqrt(v) * spread + eps)


@numba.njit(cache=True)
@no_type_check
def _count(rows, visible, steps):
    for k in range(len(rows)):
        steps[rows[k]] += visible[k]
