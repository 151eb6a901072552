"""Checkpoints: one safetensors file whose header carries the JSON, so that tensors and facts cannot come apart."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import UInt16
from numpy import ndarray
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import replace_atomically
from instdrive_core.scene.track import Track
from instdrive_core.training.gaussians.actor_poses import ActorPoses
from instdrive_core.training.gaussians.lineage import Lineage
from instdrive_core.training.gaussians.model import SceneModel
from instdrive_core.training.instances.named_masks import NamedMasks
from instdrive_core.training.settings.config import TrainConfig
from instdrive_core.training.settings.events import Stage
from instdrive_core.training.trainer import Trainer

VERSION = 3
_PARAMETER, _SHARED, _OPTIMIZER, _GROWTH = "parameter.", "shared.", "adam.", "growth."
_CAMERA, _TRACK, _LINEAGE, _NAMED = "camera.", "track.", "lineage.", "named."
_NODES = "nodes"


@dataclass(frozen=True)
class Checkpoint:
    """State of a run: all that a resumed run needs beside the clip itself."""

    config: TrainConfig
    stage: Stage
    iteration: int
    seconds: float
    scene_radius: float
    tracks: tuple[Track, ...]
    """Tracks that the actors' corrections refer to."""
    photo_keys: tuple[str, ...]
    """Keys of the training photos, in the order of their exposures."""
    nodes: UInt16[ndarray, " n"]
    tensors: dict[str, Tensor]

    def group(self, prefix: str) -> dict[str, Tensor]:
        """The tensors whose names begin with a prefix, by the rest of their names."""
        return {name.removeprefix(prefix): value for name, value in self.tensors.items() if name.startswith(prefix)}

    def model(self, photo_times: Sequence[float]) -> SceneModel:
        """The trained scene on the CPU; `photo_times` are the training photos' seconds."""
        shared = {name: value.clone().requires_grad_(True) for name, value in self.group(_SHARED).items()}
        return SceneModel(self.group(_PARAMETER), shared, self.nodes, ActorPoses(self.tracks, photo_times))


def save_checkpoint(path: Path, trainer: Trainer) -> None:
    """Write the trainer's whole state; the old file stays until the new one is complete."""
    groups = {
        _PARAMETER: trainer.model.parameters,
        _SHARED: trainer.model.shared,
        _OPTIMIZER: trainer.optimizers.state_tensors(),
        _GROWTH: trainer.growth.state_tensors(),
        _CAMERA: trainer.cameras.state_tensors(),
        _TRACK: _track_tensors(trainer.model.actor_poses.tracks),
        _LINEAGE: {} if trainer.lineage is None else trainer.lineage.state_tensors(),
        _NAMED: {} if trainer.named_masks is None else trainer.named_masks.to_tensors(),
    }
    tensors = {_NODES: torch.from_numpy(trainer.model.nodes.astype(np.int32))}
    for prefix, group in groups.items():
        tensors |= {prefix + name: value.detach().cpu().contiguous() for name, value in group.items()}
    facts = {
        "version": VERSION,
        "config": trainer.config.to_json(),
        "stage": trainer.stage,
        "iteration": trainer.iteration,
        "seconds": trainer.seconds,
        "scene_radius": trainer.scene_radius,
        "tracks": [_track_facts(track) for track in trainer.model.actor_poses.tracks],
        "photo_keys": [photo.key for photo in trainer.store.facts],
    }
    with replace_atomically(path) as temporary:
        try:
            save_file(tensors, temporary, metadata={"instdrive": json.dumps(facts)})
        except SafetensorError as error:
            raise DataError(path, f"the checkpoint cannot be written ({error})", "Free some space") from error


def load_checkpoint(path: Path) -> Checkpoint:
    """Read a checkpoint. Raises DataError where the file is damaged or from another version."""
    try:
        with safe_open(path, framework="pt") as file:
            facts: dict[str, Any] = json.loads((file.metadata() or {}).get("instdrive", "null"))
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (no mapping)
    except (SafetensorError, OSError, json.JSONDecodeError) as error:
        raise DataError(path, f"not a readable checkpoint ({error})", "Delete it to start anew.") from error
    if not isinstance(facts, dict) or facts.get("version") != VERSION:
        found = facts.get("version") if isinstance(facts, dict) else None
        raise DataError(path, f"checkpoint version is {found}, expected {VERSION}", "Delete it to start anew.")
    return Checkpoint(
        config=TrainConfig.from_json(facts["config"]),
        stage="rgb" if facts["stage"] == "rgb" else "instances",
        iteration=facts["iteration"],
        seconds=facts["seconds"],
        scene_radius=facts["scene_radius"],
        tracks=_tracks(facts["tracks"], tensors),
        photo_keys=tuple(facts["photo_keys"]),
        nodes=tensors.pop(_NODES).numpy().astype(np.uint16),
        tensors=tensors,
    )


def restore_trainer(trainer: Trainer, checkpoint: Checkpoint) -> None:
    """Put a fresh trainer, built on the checkpoint's model, where the saved one stood."""
    trainer.stage, trainer.iteration = checkpoint.stage, checkpoint.iteration
    trainer.seconds_before = checkpoint.seconds
    trainer.optimizers.load_state_tensors(checkpoint.group(_OPTIMIZER))
    trainer.growth.load_state_tensors(checkpoint.group(_GROWTH))
    trainer.cameras.load_state_tensors(checkpoint.group(_CAMERA))
    lineage = checkpoint.group(_LINEAGE)
    trainer.lineage = Lineage.from_state(lineage) if lineage else None
    named = checkpoint.group(_NAMED)
    trainer.named_masks = NamedMasks.from_tensors(named) if named else None


def _track_facts(track: Track) -> dict[str, Any]:
    return {"id": track.id, "label": track.label, "dimensions": track.dimensions.tolist(), "moving": track.moving}


def _track_tensors(tracks: tuple[Track, ...]) -> dict[str, Tensor]:
    tensors: dict[str, Tensor] = {}
    for number, track in enumerate(tracks):
        tensors[f"{number}.times"] = torch.from_numpy(track.times)
        tensors[f"{number}.world_from_box"] = torch.from_numpy(track.world_from_box)
    return tensors


def _tracks(facts: list[dict[str, Any]], tensors: dict[str, Tensor]) -> tuple[Track, ...]:
    return tuple(
        Track(
            id=entry["id"],
            label=entry["label"],
            dimensions=np.array(entry["dimensions"], np.float64),
            times=tensors[f"{_TRACK}{number}.times"].numpy(),
            world_from_box=tensors[f"{_TRACK}{number}.world_from_box"].numpy(),
            moving=entry["moving"],
        )
        for number, entry in enumerate(facts)
    )
