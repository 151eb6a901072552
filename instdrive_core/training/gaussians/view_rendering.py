"""One view of the trainable scene: only the Gaussians that may be seen take part, as leaves that gather gradients."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int64
from torch import Tensor

from instdrive_core.scene.camera import Camera
from instdrive_core.training.backends.backend import Backend, Nodes, SeenSplats
from instdrive_core.training.backends.row_gather import gather_rows
from instdrive_core.training.gaussians.actor_poses import NodePoses
from instdrive_core.training.gaussians.model import SceneModel
from instdrive_core.training.gaussians.rows_in_view import find_rows_in_view
from instdrive_core.training.gaussians.rows_on_device import find_rows_on_device

GEOMETRY = ("means", "quats", "log_scales", "opacity_logits", "sh_dc", "sh_rest")
"""The attributes that the RGB stage learns."""


@dataclass(frozen=True)
class RenderedView:
    """Picture of one camera, with nothing behind the Gaussians, and the leaves that gather its gradients."""

    rows: Int64[Tensor, " v"]
    """Rows of the model that took part."""
    splats: dict[str, Tensor]
    """Their attributes: leaves, whose `.grad` the backward pass fills."""
    seen: SeenSplats
    """Filled by the backward pass."""
    color: Float[Tensor, "h w 3"]
    features: Float[Tensor, "h w d"] | None
    tags: Float[Tensor, "h w t"] | None
    """Σ w·tag; sends gradient into geometry and opacity as colours do."""
    depth: Float[Tensor, "h w"]
    """Σ w·z."""
    alpha: Float[Tensor, "h w"]
    placed: tuple[Float[Tensor, "v 3"], Float[Tensor, "v 4"]]
    """Means and quaternions in the world; they gather gradients, too."""

    def gradients(self) -> dict[str, Tensor | None]:
        """Gradient of each attribute after the backward pass."""
        return {name: leaf.grad for name, leaf in self.splats.items()}


def render_view(
    model: SceneModel,
    backend: Backend,
    camera: Camera,
    time: float,
    with_features: bool,
    tags: Float[Tensor, "n t"] | None = None,
) -> RenderedView:
    """Render the model from one camera at one time (seconds).

    With `with_features` a feature map is rendered, too; it sends no gradient into geometry. `tags` are constants of
    each Gaussian, on the backend's device, blended like colours; they send gradient into geometry.
    """
    poses = model.actor_poses.at(time, model.corrections, camera.lag)
    rows, nodes = find_rows_of_view(model, backend, poses, camera)
    names = (*GEOMETRY, "features") if with_features else GEOMETRY
    splats = {
        name: gather_rows(model.parameters[name], rows, backend.uses_kernels).requires_grad_(True) for name in names
    }
    means, quats = backend.place_gaussians(splats["means"], splats["quats"], nodes, poses.rotations, poses.shifts)
    for tensor in (means, quats):
        if not tensor.is_leaf:
            tensor.retain_grad()
    colors = backend.evaluate_harmonics(
        means, splats["sh_dc"], splats["sh_rest"], camera.position, nodes, poses.matrices
    )
    shaping = [colors] if tags is None else [colors, tags.index_select(0, rows)]
    parts = [*shaping, splats["features"]] if with_features else shaping
    channels = torch.cat(parts, dim=1) if len(parts) > 1 else colors
    geometry_channels = sum(part.shape[1] for part in shaping)
    seen = SeenSplats()
    drawn, depth, alpha = backend.rasterize(
        means, quats, splats["log_scales"], splats["opacity_logits"], channels, camera, geometry_channels, seen
    )
    # Slices would each get a gradient of full width.
    color, *rest = drawn.split([part.shape[1] for part in parts], dim=2) if len(parts) > 1 else (drawn,)
    drawn_tags = None if tags is None else rest.pop(0)
    features = rest.pop(0) if with_features else None
    return RenderedView(rows, splats, seen, color, features, drawn_tags, depth, alpha, (means, quats))


def find_rows_of_view(
    model: SceneModel, backend: Backend, poses: NodePoses, camera: Camera
) -> tuple[Int64[Tensor, " v"], Nodes]:
    """Find the rows that may be seen, and the node of each. On a GPU both stay there; their number is read from it."""
    names = ("means", "log_scales", "opacity_logits")
    means, log_scales, logits = (model.parameters[name].detach() for name in names)
    if not backend.uses_kernels:
        background = int(np.searchsorted(model.nodes, 1))
        nodes = model.copy_nodes_to(backend.device)
        return find_rows_on_device(means, log_scales, logits, nodes, background, poses.matrices, poses.present, camera)
    arrays = means.numpy(), log_scales.numpy(), logits.numpy()
    rows = find_rows_in_view(*arrays, model.nodes, poses.matrices, poses.present, camera)
    return torch.from_numpy(rows), model.nodes[rows]
