"""Losses of steps that nobody has read yet: reading a number from a GPU waits for all that was sent there before."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float64
from torch import Tensor


@dataclass(frozen=True)
class StepLosses:
    """What one step says of itself."""

    iteration: int
    """Steps done before it in its stage."""
    terms: dict[str, float]
    """Value of each loss term, weighted, by name."""
    psnr: float
    """PSNR of the drawn photo, in dB; NaN where none was drawn."""


class UnreadLosses:
    """Gathers the losses of steps where they lie; `read` fetches all of them with one wait."""

    def __init__(self) -> None:
        self._steps: list[tuple[int, tuple[str, ...], Float64[Tensor, " t"]]] = []

    def add(self, iteration: int, terms: dict[str, Tensor], psnr: Tensor | float, device: torch.device) -> None:
        """Gather one step's terms and PSNR on `device`; nothing is waited for where they lie there already."""
        scalars = [*(term.detach() for term in terms.values()), torch.as_tensor(psnr, dtype=torch.float64)]
        self._steps.append((iteration, tuple(terms), torch.stack([scalar.to(device).double() for scalar in scalars])))

    def read(self) -> list[StepLosses]:
        """Read the steps gathered since the last call, in their order."""
        waiting, self._steps = self._steps, []
        values = iter(torch.cat([scalars for _, _, scalars in waiting]).tolist() if waiting else [])
        return [
            StepLosses(number, {name: next(values) for name in names}, next(values)) for number, names, _ in waiting
        ]
