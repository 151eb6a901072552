"""World positions of the splats at one moment, as the user sees them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float32
from numpy import ndarray

from instdrive_core.edits.document.document import Document
from instdrive_core.scene.camera import PhotoLag
from instdrive_core.scene.transforms import compute_current_means


def compute_shown_means(
    document: Document, time: float, lag: PhotoLag | None = None
) -> tuple[Float32[ndarray, "n 3"], Bool[ndarray, " n"]]:
    """World positions (metres) of all splats at `time` (seconds), moves applied, and whether each is drawn then.

    With a photo's `lag`, as the photo shows them.

    Hidden and deleted splats and those of actors that are absent are not drawn. The positions are read only.
    """
    scene = document.scene
    means, drawn = compute_current_means(scene.gaussians, document.transforms), document.state.drawn
    driving = np.flatnonzero(scene.nodes)
    if not len(driving):
        return means, drawn
    poses, present = scene.find_node_poses(time, lag)
    nodes = scene.nodes[driving]
    matrices = poses[nodes]
    placed = np.einsum("nij,nj->ni", matrices[:, :3, :3], means[driving]) + matrices[:, :3, 3]
    means = means.copy() if np.shares_memory(means, scene.gaussians.means) else means
    means[driving] = placed
    drawn[driving] &= present[nodes] > 0
    return means, drawn
