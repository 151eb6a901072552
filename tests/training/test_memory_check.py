"""Photos that cannot be trained in the memory that there is: told beforehand, with what would fit."""

import re
import sys
from dataclasses import replace
from types import SimpleNamespace

import pytest
from photo_models import COUNT, HEIGHT, WIDTH, photo_model, write_nerfstudio
from small_clip import write_small_clip
from tiny_training import new_trainer, tiny_config

from instdrive_core.available_memory import assume_memory
from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import OptionError
from instdrive_core.training import memory_check
from instdrive_core.training.backends.cpu_backend import CpuBackend
from instdrive_core.training.backends.device import measure_free_gpu_memory
from instdrive_core.training.memory_check import (
    PROGRAM_BYTES,
    STEP_BYTES,
    check_gpu_memory,
    check_training_memory,
    count_state_bytes,
    estimate_training_bytes,
    measure_peak_memory,
)
from instdrive_core.training.settings.config import build_train_config
from instdrive_core.training.views.photo_budget import BYTES_PER_PIXEL, LEAST_BUDGET


def test_a_smaller_scale_that_is_proposed_fits_and_a_larger_does_not(tmp_path):
    root = str(write_nerfstudio(tmp_path / "clip", photo_model()))
    available = PROGRAM_BYTES + 0.3 * (STEP_BYTES + (COUNT - 1) * BYTES_PER_PIXEL) * WIDTH * HEIGHT
    with assume_memory(available):
        with pytest.raises(OptionError, match=f"{COUNT - 1} photos of up to {WIDTH}×{HEIGHT} need at least") as raised:
            check_training_memory(load_clip(root, ClipOptions()))
        scale = float(re.search(r"--scale (\S+) would fit", str(raised.value))[1])
        assert 0.5 < scale < 0.6
        check_training_memory(load_clip(root, ClipOptions(scale=scale)))
        with pytest.raises(OptionError):
            check_training_memory(load_clip(root, ClipOptions(scale=scale + 0.05)))


def test_fewer_cameras_are_proposed_where_photos_are_many(tmp_path):
    root = str(write_small_clip(tmp_path / "clip"))
    clip = load_clip(root, ClipOptions(cameras="front_camera,back_camera"))
    sizes = [(frame.view.camera.width, frame.view.camera.height) for frame in clip.training_frames]
    with (
        assume_memory(estimate_training_bytes(sizes) - 1),
        pytest.raises(OptionError, match="--cameras front_camera would fit"),
    ):
        check_training_memory(clip)
    with assume_memory(estimate_training_bytes(sizes)):
        check_training_memory(clip)


def test_kept_photos_stay_within_their_budget():
    sizes = [(1000, 1000)] * 100_000
    assert estimate_training_bytes(sizes) == PROGRAM_BYTES + STEP_BYTES * 1e6 + LEAST_BUDGET


@pytest.mark.parametrize("platform", ["linux", "darwin", "win32"])
def test_the_peak_is_in_bytes_on_every_system(monkeypatch, platform):
    """Windows has no `resource` module; macOS counts bytes where Linux counts KiB."""
    megabyte, process = 2**20, SimpleNamespace(memory_info=lambda: SimpleNamespace(peak_wset=300 * 2**20))
    usage = SimpleNamespace(ru_maxrss=300 * megabyte if platform == "darwin" else 300 * 1024)
    resource = SimpleNamespace(getrusage=lambda who: usage, RUSAGE_SELF=0)
    monkeypatch.setattr(memory_check.sys, "platform", platform)
    monkeypatch.setattr(memory_check.psutil, "Process", lambda: process)
    monkeypatch.setitem(sys.modules, "resource", None if platform == "win32" else resource)
    assert measure_peak_memory() == 300 * megabyte


def test_this_process_holds_more_than_python_alone():
    assert 20e6 < measure_peak_memory() < 1e12


@pytest.mark.parametrize("learned_by", ["losses", "votes"])
def test_the_state_of_a_gaussian_is_counted_as_the_trainer_holds_it(learned_by):
    config = tiny_config()
    config = replace(config, instances=replace(config.instances, learned_by=learned_by))
    trainer, _ = new_trainer(config, harmonics=(config.geometry.sh_degree + 1) ** 2 - 1)
    optimizers, count = trainer.optimizers, len(trainer.model)
    features = [] if optimizers.features is None else [optimizers.features.state_tensors()]
    groups = (optimizers.geometry.state_tensors(), *features, trainer.growth.state_tensors())
    held = [value for group in (trainer.model.parameters, *groups) for value in group.values()]
    assert sum(value.nbytes for value in held) == count * count_state_bytes(config)
    assert bool(features) == (learned_by == "losses")


def test_too_many_gaussians_for_a_gpu_are_refused_with_a_number_that_fits():
    config = build_train_config("instdrive", "paper")
    config = replace(config, densify=replace(config.densify, max_gaussians=5_000_000))
    check_gpu_memory(config, 16 << 30)
    with pytest.raises(
        OptionError, match=r"5,000,000 Gaussians take at least .* GB .*--max-gaussians \d+, close"
    ) as told:
        check_gpu_memory(config, 2 << 30)
    fits = int(re.findall(r"--max-gaussians (\d+)", str(told.value))[0])
    assert 500_000 < fits < 5_000_000
    check_gpu_memory(replace(config, densify=replace(config.densify, max_gaussians=fits)), 2 << 30)
    check_gpu_memory(replace(config, freeze_geometry=True), 2 << 30)


def test_a_cpu_has_no_memory_of_a_gpu():
    assert measure_free_gpu_memory(CpuBackend()) is None
