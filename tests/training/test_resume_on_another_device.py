"""A checkpoint lies on the CPU: whoever resumes it elsewhere finds every tensor of the state beside its parameter."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from tiny_training import new_trainer, tiny_config

from instdrive_core.training.backends.cpu_backend import CpuBackend
from instdrive_core.training.build_trainer import resume_trainer
from instdrive_core.training.checkpoint import load_checkpoint, save_checkpoint
from instdrive_core.training.gaussians.optimizers import Optimizers
from instdrive_core.training.settings.config import TrainConfig
from instdrive_core.training.trainer import Trainer

ELSEWHERE = torch.device("meta")
"""A device of its own that every machine has; its tensors have shapes and no values."""


class BackendElsewhere(CpuBackend):
    """Nothing is drawn with it: only where tensors lie matters here."""

    device = ELSEWHERE
    uses_kernels = False


@pytest.fixture(scope="module")
def config() -> TrainConfig:
    return tiny_config("joint")


@pytest.fixture(scope="module")
def resumed(config: TrainConfig, tmp_path_factory: pytest.TempPathFactory) -> tuple[Trainer, Path]:
    """A run of three steps, resumed elsewhere, and its checkpoint."""
    path = tmp_path_factory.mktemp("run") / "checkpoint.safetensors"
    trainer, _ = new_trainer(config)
    for _ in range(3):
        trainer.rgb_step()
        trainer.iteration += 1
    save_checkpoint(path, trainer)
    return resume_trainer(config, trainer.store, path, load_checkpoint(path), BackendElsewhere()), path


def test_every_tensor_of_the_state_lies_where_its_parameter_does(resumed: tuple[Trainer, Path]) -> None:
    trainer, path = resumed
    state = trainer.optimizers.state_tensors() | trainer.growth.state_tensors()
    assert {f"adam.{name}" for name in trainer.optimizers.state_tensors()} == {
        name for name in load_checkpoint(path).tensors if name.startswith("adam.")
    }
    assert {"sky.exp_avg", "sky.exp_avg_sq", "sky.step", "geometry.first.means", "geometry.steps"} <= set(state)
    parameters = trainer.model.parameters | trainer.model.shared
    assert {name: value.device for name, value in parameters.items()} == dict.fromkeys(parameters, ELSEWHERE)
    assert {name: value.device for name, value in state.items()} == dict.fromkeys(state, ELSEWHERE)


def test_optimisers_take_over_the_state_by_value(config: TrainConfig, resumed: tuple[Trainer, Path]) -> None:
    """A later step must not write into the checkpoint's tensors."""
    _, path = resumed
    checkpoint = load_checkpoint(path)
    saved = checkpoint.group("adam.")
    trainer, _ = new_trainer(config)
    optimizers = Optimizers(trainer.model, config)
    optimizers.load_state_tensors(saved)
    for name, value in optimizers.state_tensors().items():
        torch.testing.assert_close(value, saved[name], rtol=0, atol=0)
        assert not value.numel() or value.data_ptr() != saved[name].data_ptr()
