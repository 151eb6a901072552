"""What training leaves that nobody will ever see, dropped at its end: a finished scene has nothing to mend."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool, UInt16
from numpy import ndarray
from torch import Tensor

from instdrive_core.maths.activations import logit
from instdrive_core.maths.extent import measure_extent
from instdrive_core.scene.lint import FAR_RADII, VISIBLE_OPACITY
from instdrive_core.training.gaussians.densify import DensifyResult


@torch.no_grad()
def drop_never_shown(
    parameters: dict[str, Tensor], nodes: UInt16[ndarray, " n"], spared: Bool[ndarray, " n"] | None = None
) -> DensifyResult:
    """Drop all but what `find_shown` keeps of the same arguments. Pure: nothing given is changed."""
    kept = np.flatnonzero(find_shown(parameters, nodes, spared))
    rows = torch.from_numpy(kept).to(parameters["means"].device)
    left = {name: value.index_select(0, rows).requires_grad_(value.requires_grad) for name, value in parameters.items()}
    fresh = np.zeros(len(kept), bool)
    return DensifyResult(left, nodes[kept], kept, fresh, cloned=0, split=0, pruned=len(nodes) - len(kept))


@torch.no_grad()
def find_shown(
    parameters: dict[str, Tensor], nodes: UInt16[ndarray, " n"], spared: Bool[ndarray, " n"] | None = None
) -> Bool[ndarray, " n"]:
    """Find what the finished scene keeps: all but splats too faint for any rasterizer, and single ones far outside.

    Nothing is pruned any more once growing has ended. The most opaque one always stays, and so does what is no number,
    which must be told.

    Args:
        parameters: `means` (n, 3) in metres and `opacity_logits` (n,).
        nodes: which move with an actor; only the others tell how large the scene is.
        spared: rows that stay whatever they are; None = none.
    """
    logits = parameters["opacity_logits"].cpu().numpy()
    means = parameters["means"].cpu().numpy()
    shown = ~(logits < logit(np.array([VISIBLE_OPACITY]))[0])
    extent = measure_extent(means, np.flatnonzero((nodes == 0) & np.isfinite(means).all(axis=1)))
    if extent is not None:
        shown[extent.rows[extent.distances > FAR_RADII * extent.radius]] = False
    if len(logits):
        shown[int(logits.argmax())] = True
    return shown if spared is None else shown | spared
