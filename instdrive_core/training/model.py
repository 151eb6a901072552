"""The trainable scene: one torch parameter per Gaussian attribute, plus the sky; actors ride on fixed tracks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Float64, UInt16
from numpy import ndarray
from torch import Tensor

from instdrive_core.maths.rotations import multiplication_matrices, quaternion_from_matrix
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.track import Track

ABSENT_LOGIT = -20.0
"""Opacity logit of an actor's Gaussians at times when its track does not exist."""


@dataclass
class SceneModel:
    """Parameters named as in `Gaussians`, rows ordered background first, then actor by actor."""

    parameters: dict[str, Tensor]
    """means, quats, log_scales, opacity_logits, sh_dc, sh_rest, features, and sky (6, r, r, 3)."""
    nodes: UInt16[ndarray, " n"]
    actors: tuple[Track, ...]

    def __post_init__(self) -> None:
        moved = np.flatnonzero(self.nodes)
        self.first_actor_row = int(moved[0]) if len(moved) else len(self.nodes)
        if not np.all(self.nodes[self.first_actor_row :] > 0):
            raise ValueError("rows must be ordered: background first, then actors")
        self._poses: dict[float, tuple[ndarray, ndarray]] = {}
        self._actor_nodes = torch.from_numpy(self.nodes[self.first_actor_row :].astype(np.int64))

    def __len__(self) -> int:
        return len(self.nodes)

    def poses_at(self, time: float) -> tuple[Float64[ndarray, "m 4 4"], Bool[ndarray, " m"]]:
        """world_from_node of every node (background first) at `time`, and which exist then."""
        if time not in self._poses:
            poses = np.stack([np.eye(4), *(actor.pose_at(time) for actor in self.actors)])
            present = np.array([True, *(actor.covers(time) for actor in self.actors)])
            self._poses[time] = poses, present
        return self._poses[time]

    def placed(
        self, poses: Float64[ndarray, "m 4 4"], present: Bool[ndarray, " m"]
    ) -> tuple[Float[Tensor, "n 3"], Float[Tensor, "n 4"], Float[Tensor, " n"]]:
        """Means, quaternions and opacity logits in the world at one time; gradients pass through the poses."""
        means, quats = self.parameters["means"], self.parameters["quats"]
        logits, first = self.parameters["opacity_logits"], self.first_actor_row
        if first == len(self):
            return means, quats, logits
        rotations = torch.from_numpy(poses[:, :3, :3].astype(np.float32))[self._actor_nodes]
        shifts = torch.from_numpy(poses[:, :3, 3].astype(np.float32))[self._actor_nodes]
        turns = multiplication_matrices(quaternion_from_matrix(poses[:, :3, :3])).astype(np.float32)
        there = torch.from_numpy(present)[self._actor_nodes]
        moved = torch.einsum("nij,nj->ni", rotations, means[first:]) + shifts
        turned = torch.einsum("nij,nj->ni", torch.from_numpy(turns)[self._actor_nodes], quats[first:])
        shown = torch.where(there, logits[first:], ABSENT_LOGIT)
        return (
            torch.cat([means[:first], moved]),
            torch.cat([quats[:first], turned]),
            torch.cat([logits[:first], shown]),
        )

    def gaussians(self) -> Gaussians:
        """A numpy copy, every actor in its box frame."""
        arrays = {name: value.detach().numpy().copy() for name, value in self.parameters.items() if name != "sky"}
        return Gaussians(**arrays)


def model_from_gaussians(
    gaussians: Gaussians, nodes: UInt16[ndarray, " n"], actors: tuple[Track, ...], sky: Float[ndarray, "6 r r 3"]
) -> SceneModel:
    """A trainable copy."""
    parameters = {name: torch.from_numpy(array.copy()) for name, array in gaussians.arrays().items()}
    parameters["sky"] = torch.from_numpy(np.ascontiguousarray(sky, dtype=np.float32))
    for tensor in parameters.values():
        tensor.requires_grad_(True)
    return SceneModel(parameters, nodes, actors)
