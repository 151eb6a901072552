"""Which Gaussian of a finished scene each one comes from, while training goes on from that scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Int64
from numpy import ndarray
from torch import Tensor


@dataclass(frozen=True)
class Lineage:
    """Rows of the finished scene, by the rows of the model that trains on."""

    ancestors: Int64[ndarray, " n"]
    """The row of the finished scene that each one was, or grew from."""
    stands: Bool[ndarray, " n"]
    """Whether it stands for that row itself: each row of the finished scene has exactly one that does."""

    @staticmethod
    def begin(rows: Int64[ndarray, " n"]) -> Lineage:
        """Begin with the rows of the finished scene in this order."""
        return Lineage(rows.astype(np.int64), np.ones(len(rows), bool))

    def __len__(self) -> int:
        return len(self.ancestors)

    def rearrange(self, parents: Int64[ndarray, " m"], fresh: Bool[ndarray, " m"]) -> Lineage:
        """Follow a refinement, as `DensifyResult` tells it; of two halves of a split, the first stands for the whole.

        Raises ValueError where a Gaussian that stands for a row was removed.
        """
        chosen = np.full(len(self), -1)
        for candidates in (fresh, ~fresh):  # the original, where it stayed, comes last and so wins
            rows = np.flatnonzero(candidates)[::-1]  # of several the first comes last
            chosen[parents[rows]] = rows
        if (chosen[self.stands] < 0).any():
            raise ValueError("a Gaussian of the finished scene was removed")
        stands = np.zeros(len(parents), bool)
        stands[chosen[self.stands]] = True
        return Lineage(self.ancestors[parents], stands)

    def state_tensors(self) -> dict[str, Tensor]:
        """Tensors that a checkpoint keeps, by name."""
        return {"ancestors": torch.from_numpy(self.ancestors), "stands": torch.from_numpy(self.stands)}

    @staticmethod
    def from_state(tensors: dict[str, Tensor]) -> Lineage:
        """Read what `state_tensors` gave."""
        return Lineage(tensors["ancestors"].numpy(), tensors["stands"].numpy())
