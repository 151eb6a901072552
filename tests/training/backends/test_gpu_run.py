"""Whole runs on a stand-in for a GPU: the branches that a GPU takes, from the first step to the end on the CPU."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from tiny_training import new_trainer, tiny_config
from torch.overrides import TorchFunctionMode, resolve_name
from torch_splatting import GPU, backend_of

from instdrive_core.training.backends import row_gather
from instdrive_core.training.backends.backend import Backend
from instdrive_core.training.backends.cpu_backend import CpuBackend
from instdrive_core.training.build_trainer import resume_trainer
from instdrive_core.training.checkpoint import load_checkpoint, save_checkpoint
from instdrive_core.training.gaussians import view_rendering, visible_adam
from instdrive_core.training.settings.config import TrainConfig, keep_cameras
from instdrive_core.training.settings.events import DensifyDone, Event, StepDone
from instdrive_core.training.trainer import Trainer, TrainingDivergedError

CUBIC = 15
"""Harmonics of degree 3 beside the constant one."""


def short_config(schedule: str = "joint") -> TrainConfig:
    """Twelve steps, two of them at half resolution, with refinements and a reset of the opacities after the fifth."""
    config = tiny_config(schedule)
    return replace(
        config,
        geometry=replace(config.geometry, iterations=12, coarse_iterations=2),
        instances=replace(config.instances, iterations=4),
        densify=replace(
            config.densify, start=1, stop=1.0, every=2, gradient_threshold=1e-3, reset_every=4, max_gaussians=200
        ),
        report_every=1,
    )


def go_through(trainer: Trainer) -> list[Event]:
    """What a run says of its steps and refinements."""
    return [event for event in trainer.run() if isinstance(event, StepDone | DensifyDone)]


def describe_state(trainer: Trainer) -> dict[str, torch.Tensor]:
    model, optimizers = trainer.model, trainer.optimizers
    return model.parameters | model.shared | optimizers.state_tensors() | trainer.growth.state_tensors()


@pytest.mark.parametrize("kind", ["like 1.6", GPU])
def test_a_run_is_that_of_the_cpu(kind: str) -> None:
    """Joint losses, harmonics of degree 3, refinements and a reset of the opacities."""
    ours, _ = new_trainer(short_config(), backend_of(kind), CUBIC)
    theirs, _ = new_trainer(short_config(), CpuBackend(), CUBIC)
    found, expected = go_through(ours), go_through(theirs)
    assert [(type(event), event.iteration) for event in found] == [(type(event), event.iteration) for event in expected]
    for event, wanted in zip(found, expected, strict=True):
        if isinstance(event, StepDone) and isinstance(wanted, StepDone):
            assert event.terms.keys() == wanted.terms.keys()
            assert event.terms["rgb"] == pytest.approx(wanted.terms["rgb"], rel=0.02)
            assert event.psnr == pytest.approx(wanted.psnr, abs=0.1)
        elif isinstance(event, DensifyDone) and isinstance(wanted, DensifyDone):
            assert (event.gaussians, event.split) == pytest.approx((wanted.gaussians, wanted.split), abs=4)
    assert any(isinstance(event, DensifyDone) and event.split for event in found)
    assert float(ours.model.parameters["opacity_logits"].max()) < 0, "opacities were reset"
    assert float(ours.model.parameters["sh_rest"].abs().max()) > 0


def fail_if_called(*_: object) -> None:
    pytest.fail("a kernel that reads the CPU's memory ran in a step on the GPU")


def test_no_kernel_of_the_cpu_runs_in_a_step_on_the_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    """On the stand-in it would work, on a GPU it cannot. The poses of cameras lie on the CPU anywhere."""
    trainer, _ = new_trainer(keep_cameras(short_config()), backend_of("like 1.5"), CUBIC)
    monkeypatch.setattr(visible_adam, "_update", fail_if_called)
    monkeypatch.setattr(row_gather, "_gather", fail_if_called)
    monkeypatch.setattr(view_rendering, "find_rows_in_view", fail_if_called)
    assert go_through(trainer)


def test_a_resumed_run_goes_on_where_it_stood(tmp_path: Path) -> None:
    """Killed between a refinement and the reset; on the stand-in, which adds in fixed order, bit for bit."""
    config, path = short_config("after"), tmp_path / "checkpoint.safetensors"
    through, _ = new_trainer(config, backend_of("like 1.5"), CUBIC)
    killed, _ = new_trainer(config, backend_of("like 1.5"), CUBIC)
    for _ in range(4):
        killed.rgb_step()
        killed.after_rgb_step()
        killed.iteration += 1
    save_checkpoint(path, killed)
    resumed = resume_trainer(config, killed.store, path, load_checkpoint(path), backend_of("like 1.5"))
    assert go_through(resumed)[-1].iteration == go_through(through)[-1].iteration
    expected = describe_state(through)
    for name, value in describe_state(resumed).items():
        assert torch.equal(value, expected[name]), name


@pytest.mark.parametrize("backends", [("like 1.5", "cpu"), ("cpu", "like 1.5")], ids=["to the CPU", "to the GPU"])
def test_a_run_may_change_the_device(backends: tuple[str, str], tmp_path: Path) -> None:
    config, path = short_config(), tmp_path / "checkpoint.safetensors"

    def build_backend(kind: str) -> Backend:
        return CpuBackend() if kind == "cpu" else backend_of(kind)

    first, _ = new_trainer(config, build_backend(backends[0]), CUBIC)
    first.rgb_step()
    first.iteration += 1
    save_checkpoint(path, first)
    second = resume_trainer(config, first.store, path, load_checkpoint(path), build_backend(backends[1]))
    first.rgb_step()
    second.rgb_step()
    assert second.read_losses().terms["rgb"] == pytest.approx(first.read_losses().terms["rgb"], rel=1e-3)


def test_the_instance_stage_goes_on_on_the_cpu_with_all_that_was_learned() -> None:
    trainer, _ = new_trainer(short_config("after"), backend_of("like 1.5"), CUBIC)
    for _ in range(3):
        trainer.rgb_step()
        trainer.iteration += 1
    before = {name: value.detach().clone() for name, value in describe_state(trainer).items()}
    trainer.continue_on_cpu()
    assert trainer.backend.name == "cpu"
    after = describe_state(trainer)
    assert before.keys() == after.keys()
    for name, value in before.items():
        assert torch.equal(after[name], value), name
    assert trainer.optimizers.geometry.by_kernels
    trainer.rgb_step()  # on kernels from here on
    assert torch.isfinite(trainer.model.parameters["means"]).all()


WAITING = {
    "item",
    "tolist",
    "cpu",
    "numpy",
    "nonzero",
    "masked_select",
    "__bool__",
    "__float__",
    "__int__",
    "__index__",
}


class HostReads(TorchFunctionMode):
    """While it is on, `calls` gathers what waits for the device; that of the files in `but` is left out.

    Indexing with a mask counts: the number of rows has to be read.
    """

    def __init__(self, but: tuple[str, ...]) -> None:
        super().__init__()
        self.but, self.calls = but, []

    def __torch_function__(self, func, types, args=(), kwargs=None):
        name = (resolve_name(func) or str(func)).rpartition(".")[2]
        mask = name in ("__getitem__", "__setitem__", "index") and self._is_mask(args[1])
        if mask or name in WAITING:
            frame = sys._getframe(1)
            caller = frame.f_code.co_name
            while frame is not None and not frame.f_code.co_filename.endswith(self.but):
                frame = frame.f_back
            if frame is None:
                self.calls.append(f"{name} in {caller}")
        return func(*args, **(kwargs or {}))

    @staticmethod
    def _is_mask(index):
        parts = index if isinstance(index, tuple) else (index,)
        return any(isinstance(part, torch.Tensor) and part.dtype == torch.bool for part in parts)


def test_a_step_waits_for_the_gpu_once_and_steps_are_read_together() -> None:
    """For the number of rows in view; gsplat itself waits for the length of its lists. Losses wait to be read."""
    trainer, _ = new_trainer(keep_cameras(short_config("after")), backend_of("like 1.6"), CUBIC)
    for _ in range(2):
        trainer.rgb_step()
        trainer.iteration += 1
    on_the_cpu = ("camera_poses.py", "actor_poses.py")  # anywhere; without actors there is nothing to wait for
    with HostReads(but=("torch_splatting.py", *on_the_cpu)) as reads:
        trainer.rgb_step()
        assert reads.calls == ["tolist in find_rows_on_device"]
        trainer.iteration += 1
        assert trainer.read_losses().iteration == 2
    assert reads.calls[1:] == ["tolist in read"], "all three steps are read at once"


def test_a_loss_that_is_not_finite_is_told_of_its_own_step() -> None:
    """Though it is read with those of later steps, before anything is saved."""
    trainer, _ = new_trainer(
        keep_cameras(replace(short_config("after"), report_every=8)), backend_of("like 1.6"), CUBIC
    )
    for step in range(4):
        if step == 1:
            trainer.model.shared["exposures"].data[:] = float("nan")
        trainer.rgb_step()
        trainer.iteration += 1
    with pytest.raises(TrainingDivergedError, match="rgb loss is nan at step 1 of the rgb stage"):
        trainer.check_parameters()


@pytest.mark.parametrize("kind", ["cpu", "like 1.6"])
def test_nothing_is_held_of_features_where_votes_learn_instances(kind: str) -> None:
    """Neither values nor moments nor counts, through growth, a checkpoint and a resumed run."""
    config = short_config("after")
    config = replace(config, instances=replace(config.instances, learned_by="votes", schedule="joint"))
    backend = CpuBackend() if kind == "cpu" else backend_of(kind)
    trainer, _ = new_trainer(config, backend, CUBIC)
    assert len(go_through(trainer)) > config.geometry.iterations, "steps and refinements"
    names = [name for name, value in describe_state(trainer).items() if "feature" in name and value.numel()]
    assert names == []
    assert len(trainer.model) > 120, "it has grown"
