"""Per-Gaussian features that a baseline learns on cached blending weights; the geometry is never touched."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Int64
from torch import Tensor

from instdrive_core.maths.streams import Stream, make_generator
from instdrive_core.training.backends.row_gather import gather_rows
from instdrive_core.training.gaussians.visible_adam import VisibleAdam

NO_MASKS = "no view shows a mask on the scene: nothing to learn instances from"


class LearnableFeatures:
    """A feature of d numbers for each of n Gaussians, and its optimiser.

    Args:
        count: n.
        dim: d.
        std: of the first values, normally distributed.
        rate: Adam's step; only rows that a step saw move (3DGS's sparse Adam).
        seed: of the first values.
    """

    def __init__(self, count: int, dim: int, std: float, rate: float, seed: int) -> None:
        first = make_generator(seed, Stream.BASELINE_FEATURES).normal(0, std, (count, dim))
        self.values: Float[Tensor, "n d"] = torch.from_numpy(first.astype(np.float32))
        self._optimizer = VisibleAdam({"features": self.values}, {"features": rate})

    def restart(self, rate: float) -> None:
        """Begin another stage: a new rate, moments from zero."""
        self._optimizer = VisibleAdam({"features": self.values}, {"features": rate})

    def leaf(self, rows: Int64[Tensor, " v"]) -> Float[Tensor, "v d"]:
        """Copy some rows so that a loss can be differentiated by them."""
        return gather_rows(self.values, rows).requires_grad_(True)

    def descend(self, *parts: tuple[Int64[Tensor, " _"], Float[Tensor, "_ d"]]) -> None:
        """Take one step along the gradients of leaves, each with its (distinct) rows; parts may share rows."""
        parts = tuple((rows, leaf) for rows, leaf in parts if leaf.grad is not None)
        if not parts:
            return
        rows, gradient = parts[0][0], parts[0][1].grad
        if len(parts) > 1:
            rows = torch.unique(torch.cat([rows for rows, _ in parts]))
            gradient = torch.zeros(len(rows), self.values.shape[1])
            for some, leaf in parts:
                assert leaf.grad is not None
                gradient.index_add_(0, torch.searchsorted(rows, some), leaf.grad)
        self._optimizer.step(rows, {"features": gradient})
