"""Checkpoints: one safetensors file whose header carries the JSON, so that tensors and facts cannot come apart."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import UInt16
from numpy import ndarray
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from instdrive_core.errors import DataError
from instdrive_core.formats.atomic import write_bytes
from instdrive_core.training.config import TrainConfig
from instdrive_core.training.trainer import Trainer

VERSION = 1
_PARAMETER, _FIRST, _SECOND, _NODES = "parameter.", "adam.first.", "adam.second.", "nodes"


@dataclass(frozen=True)
class Checkpoint:
    """Everything that a resumed run needs beside the clip itself."""

    config: TrainConfig
    stage: str
    iteration: int
    seconds: float
    scene_radius: float
    actor_ids: tuple[str, ...]
    adam_steps: dict[str, float]
    nodes: UInt16[ndarray, " n"]
    tensors: dict[str, Tensor]

    def parameters(self) -> dict[str, Tensor]:
        """The trained tensors by name."""
        return {
            name.removeprefix(_PARAMETER): value for name, value in self.tensors.items() if name.startswith(_PARAMETER)
        }


def save_checkpoint(path: Path, trainer: Trainer) -> None:
    """Write the trainer's whole state; the old file stays until the new one is complete."""
    tensors: dict[str, Tensor] = {_NODES: torch.from_numpy(trainer.model.nodes.astype(np.int32))}
    steps: dict[str, float] = {}
    for name, value in trainer.model.parameters.items():
        tensors[_PARAMETER + name] = value.detach()
    for name, optimizer in trainer.optimizers.items():
        for state in optimizer.state.values():
            tensors[_FIRST + name], tensors[_SECOND + name] = state["exp_avg"], state["exp_avg_sq"]
            steps[name] = float(state["step"])
    facts = {
        "version": VERSION,
        "config": trainer.config.to_json(),
        "stage": trainer.stage,
        "iteration": trainer.iteration,
        "seconds": trainer.seconds,
        "scene_radius": trainer.scene_radius,
        "actor_ids": [actor.id for actor in trainer.model.actors],
        "adam_steps": steps,
    }
    contiguous = {name: tensor.contiguous() for name, tensor in tensors.items()}
    write_bytes(path, save(contiguous, metadata={"instdrive": json.dumps(facts)}))


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
        stage=facts["stage"],
        iteration=facts["iteration"],
        seconds=facts["seconds"],
        scene_radius=facts["scene_radius"],
        actor_ids=tuple(facts["actor_ids"]),
        adam_steps=facts["adam_steps"],
        nodes=tensors.pop(_NODES).numpy().astype(np.uint16),
        tensors=tensors,
    )


def restore(trainer: Trainer, checkpoint: Checkpoint) -> None:
    """Put a fresh trainer, built on the checkpoint's parameters, where the saved one stood."""
    trainer.stage = "rgb" if checkpoint.stage == "rgb" else "instances"
    trainer.iteration, trainer.seconds_before = checkpoint.iteration, checkpoint.seconds
    for name, optimizer in trainer.optimizers.items():
        if name not in checkpoint.adam_steps:
            continue
        parameter = trainer.model.parameters[name]
        optimizer.state[parameter] = {
            "step": torch.tensor(checkpoint.adam_steps[name]),
            "exp_avg": checkpoint.tensors[_FIRST + name].clone(),
            "exp_avg_sq": checkpoint.tensors[_SECOND + name].clone(),
        }
