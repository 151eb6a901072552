"""Keeps the Gaussians of moving objects on them: what is larger than its object paints the ground that it passes."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, Int64, UInt16
from numpy import ndarray
from torch import Tensor

from instdrive_core.instances.shadows import BESIDE, find_learned_shadows
from instdrive_core.maths.rotations import matrix_from_quaternion, normalize_quaternions

LIMIT_MOVERS_EVERY = 10
"""Steps from one time to the next: in between a size grows by a twentieth at most."""
EXTENT = 2.0
"""Standard deviations from a Gaussian's middle to what counts as its end: beyond lies a seventh of what it shows."""
MARGIN = BESIDE
"""Metres around the box that are still the object itself: legs, mirrors, loads."""
LEAST = 0.1
"""Metres that a Gaussian may reach in any direction, wherever its middle lies."""


@torch.no_grad()
def keep_on_movers(
    parameters: dict[str, Tensor],
    nodes: UInt16[ndarray, " n"],
    dimensions: Float[ndarray, "k 3"],
    spared: Bool[ndarray, " n"] | None = None,
) -> None:
    """Move and shrink, in place, what reaches farther out of its object's box than `MARGIN`; shadows may.

    A person's shadow, or the mean light of a patch that photos show around it, can be learned by a few Gaussians with
    the size of that patch. They are drawn, selected and deleted as part of the person.

    Args:
        parameters: `means` (n, 3), `quats` (n, 4), `log_scales` (n, 3) and `sh_dc` (n, 3) in the frames of the boxes.
        nodes: k = the object with the k-th box, 0 = what stands still.
        dimensions: metres along the axes of each box.
        spared: rows that stay as they are; None = none.
    """
    rows = np.flatnonzero(nodes > 0 if spared is None else (nodes > 0) & ~spared)
    means, log_scales = (_take(parameters[name], rows) for name in ("means", "log_scales"))
    limits = (dimensions / 2 + MARGIN).astype(np.float32)[nodes[rows] - 1]
    # Few are large enough to reach out, whichever way they are turned: the rest costs no time.
    suspects = (np.abs(means) + EXTENT * np.exp(log_scales.max(axis=1, keepdims=True)) > limits).any(axis=1)
    rows, means, log_scales, limits = rows[suspects], means[suspects], log_scales[suspects], limits[suspects]
    quats, sh_dc = (_take(parameters[name], rows) for name in ("quats", "sh_dc"))
    solid = ~find_learned_shadows(means, quats, log_scales, sh_dc, nodes[rows], dimensions)
    held = np.clip(means, -limits, limits)
    room = np.maximum(limits - np.abs(held), LEAST)
    axes = np.abs(matrix_from_quaternion(normalize_quaternions(quats)))
    largest = (room[:, :, None] / (EXTENT * np.maximum(axes, 1e-6))).min(axis=1)
    shrunk = np.minimum(log_scales, np.log(largest))
    _put(parameters["means"], rows[solid], held[solid])
    _put(parameters["log_scales"], rows[solid], shrunk[solid])


def _take(values: Tensor, rows: Int64[ndarray, " k"]) -> Float32[ndarray, "k d"]:
    return values.index_select(0, torch.from_numpy(rows).to(values.device)).cpu().numpy()


def _put(values: Tensor, rows: Int64[ndarray, " k"], fresh: Float[ndarray, "k d"]) -> None:
    values[torch.from_numpy(rows).to(values.device)] = torch.from_numpy(fresh.astype(np.float32)).to(values.device)
