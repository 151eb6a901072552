"""Keeps Gaussians from growing larger than the scene."""

import numpy as np
import torch
from jaxtyping import Bool, UInt16
from numpy import ndarray
from torch import Tensor

from instdrive_core.maths.extent import measure_extent

LARGEST_SHARE = 0.99
"""Share of the scene's radius that a standard deviation reaches; below 1 so that rounding makes nothing larger."""


@torch.no_grad()
def limit_sizes(
    parameters: dict[str, Tensor], nodes: UInt16[ndarray, " n"], spared: Bool[ndarray, " n"] | None = None
) -> None:
    """Shrink, in place, what is larger than the scene to the scene's radius.

    What no photo sees from two sides, such as the haze below the horizon, can grow without end while its picture stays
    the same. One such Gaussian veils the view from everywhere else.

    Args:
        parameters: `means` (n, 3) and `log_scales` (n, 3) in metres.
        nodes: which move with an actor; only the others tell how large the scene is.
        spared: rows that stay as they are; None = none.
    """
    extent = measure_extent(parameters["means"].detach().cpu().numpy(), np.flatnonzero(nodes == 0))
    if extent is None:
        return
    log_scales = parameters["log_scales"]
    limited = log_scales.clamp(max=float(np.log(LARGEST_SHARE * extent.radius)))
    if spared is not None:
        limited = torch.where(torch.from_numpy(spared).to(limited.device)[:, None], log_scales, limited)
    log_scales.copy_(limited)
