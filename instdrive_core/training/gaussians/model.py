"""The trainable scene: one tensor per Gaussian attribute, and what all Gaussians share: sky, tracks, exposures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from jaxtyping import Float, Int32, UInt16
from numpy import ndarray
from torch import Tensor

from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.track import Track
from instdrive_core.training.gaussians.actor_poses import ActorPoses
from instdrive_core.training.gaussians.exposures import make_initial_exposures


@dataclass
class SceneModel:
    """Rows are ordered background first, then actor by actor; an actor's Gaussians live in its box frame."""

    parameters: dict[str, Tensor]
    """means, quats, log_scales, opacity_logits, sh_dc, sh_rest, features: one row per Gaussian."""
    shared: dict[str, Tensor]
    """sky (6, r, r, 3), exposures (V, 3, 4) of the training photos, track_shifts and track_turns (K, 3)."""
    nodes: UInt16[ndarray, " n"]
    actor_poses: ActorPoses
    _copied_nodes: tuple[UInt16[ndarray, " n"], Int32[Tensor, " n"]] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        if np.any(np.diff(self.nodes.astype(np.int64)) < 0):
            raise ValueError("rows must be ordered: background first, then actor by actor")

    def __len__(self) -> int:
        return len(self.nodes)

    @property
    def corrections(self) -> dict[str, Tensor]:
        """Learned corrections of the actors' tracks."""
        return {name: self.shared[name] for name in ("track_shifts", "track_turns")}

    def copy_nodes_to(self, device: torch.device) -> Int32[Tensor, " n"]:
        """Copy `nodes` to a device, once for as long as they stay as they are."""
        if self._copied_nodes is None or self._copied_nodes[0] is not self.nodes:
            self._copied_nodes = self.nodes, torch.from_numpy(self.nodes.astype(np.int32)).to(device)
        return self._copied_nodes[1].to(device)

    def tracks(self) -> tuple[Track, ...]:
        """The actors' tracks, corrected."""
        return self.actor_poses.correct_tracks(self.corrections)

    def gaussians(self) -> Gaussians:
        """A numpy copy, every actor in its box frame."""
        return Gaussians(**{name: value.detach().cpu().numpy().copy() for name, value in self.parameters.items()})

    def copy_to_cpu(self) -> SceneModel:
        """Copy everything to the CPU, as constants."""
        parameters = {name: value.detach().cpu() for name, value in self.parameters.items()}
        shared = {name: value.detach().cpu() for name, value in self.shared.items()}
        return SceneModel(parameters, shared, self.nodes, self.actor_poses)

    def move_to(self, device: torch.device) -> None:
        """Put every tensor on a device."""
        self.parameters = {name: value.to(device) for name, value in self.parameters.items()}
        self.shared = {name: value.detach().to(device).requires_grad_(True) for name, value in self.shared.items()}


def build_model(
    gaussians: Gaussians,
    nodes: UInt16[ndarray, " n"],
    actors: tuple[Track, ...],
    sky: Float[ndarray, "6 r r 3"],
    photo_times: Sequence[float],
) -> SceneModel:
    """Build a trainable copy of Gaussians, with tracks as given and neutral exposures.

    `photo_times` are those of the training photos, in seconds.
    """
    parameters = {name: torch.from_numpy(array.copy()) for name, array in gaussians.arrays().items()}
    actor_poses = ActorPoses(actors, photo_times)
    shared = {
        "sky": torch.from_numpy(np.array(sky, np.float32)),
        "exposures": make_initial_exposures(len(photo_times)),
        **actor_poses.initial_corrections(),
    }
    for tensor in shared.values():
        tensor.requires_grad_(True)
    return SceneModel(parameters, shared, nodes, actor_poses)
