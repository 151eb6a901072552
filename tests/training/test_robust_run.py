"""Runs that are killed, run out of disk, or have next to nothing to train on."""

import errno
import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.errors import DataError
from instdrive_core.files import atomic
from instdrive_core.formats.folder.scenes import read_scene_folder
from instdrive_core.training.run import CHECKPOINT, LOG, RunRequest, run_training
from instdrive_core.training.settings.config import InitConfig, TrainConfig, build_train_config

PROGRAM = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from test_robust_run import run_until_killed
run_until_killed(Path(sys.argv[2]), Path(sys.argv[3]), sys.argv[4] == "resume", int(sys.argv[5]))
"""
NEVER = 1_000_000


def short() -> TrainConfig:
    config = build_train_config("instdrive", "demo", seed=1)
    return replace(
        config,
        init=InitConfig(lidar_points=2_000, near_points=200, far_points=200, actor_points=100),
        geometry=replace(config.geometry, iterations=60, coarse_iterations=10, sky_resolution=8),
        densify=replace(config.densify, start=5, every=7, stop=0.8, reset_every=20, gradient_threshold=1e-5),
        instances=replace(config.instances, learned_by="losses", iterations=60, pixels_per_view=500, feature_dim=8),
        checkpoint_every=10,
        report_every=1,
    )


def run(clip: Path, out: Path, resume: bool = False, progress=lambda event: None, **options) -> Path:
    request = RunRequest(clip, out, ClipOptions(cameras="1", **options), short(), resume=resume)
    return run_training(request, progress, lambda note: None)


def run_until_killed(clip: Path, out: Path, resume: bool, lines: int) -> None:
    """Die as suddenly as by `kill -9` once the log has so many lines: at the same place on every machine."""

    def progress(event: object) -> None:
        if (out / LOG).exists() and len((out / LOG).read_bytes().splitlines()) >= lines:
            os.kill(os.getpid(), signal.SIGKILL)

    run(clip, out, resume, progress)


@pytest.fixture(scope="module")
def street(tmp_path_factory):
    from written_street import SMALL, copy_street  # the child processes that import this file do not find it

    return copy_street(SMALL, tmp_path_factory.mktemp("street") / "clip", tmp_path_factory)


@pytest.fixture(scope="module")
def whole(street, tmp_path_factory):
    """An uninterrupted run, in a process of its own: this one may have compiled kernels itself (see `warm_up`)."""
    out = tmp_path_factory.mktemp("whole") / "run"
    finished(started(street, out))
    return out


def finished(process: subprocess.Popen) -> None:
    _, errors = process.communicate(timeout=500)
    assert process.returncode == 0, errors.decode()


def started(street: Path, out: Path, resume: bool = False, lines: int = NEVER) -> subprocess.Popen:
    command = [sys.executable, "-c", PROGRAM, str(Path(__file__).parent), str(street), str(out)]
    return subprocess.Popen([*command, "resume" if resume else "new", str(lines)], stderr=subprocess.PIPE)


def assert_same_run(one: Path, other: Path) -> None:
    first, second = load_file(one / CHECKPOINT), load_file(other / CHECKPOINT)
    assert first.keys() == second.keys()
    for name, array in first.items():
        np.testing.assert_array_equal(second[name], array, err_msg=name)
    assert logged_steps(one) == logged_steps(other)


def logged_steps(out: Path) -> list[tuple[str, int]]:
    lines = [json.loads(line) for line in (out / LOG).read_text().splitlines()]
    return [(line["stage"], line["iteration"]) for line in lines]


def killed_after(street: Path, out: Path, lines: int, resume: bool) -> None:
    """Start a run in a process of its own that is killed once the log has so many lines."""
    process = started(street, out, resume, lines)
    _, errors = process.communicate(timeout=500)
    assert process.returncode == -signal.SIGKILL, errors.decode()
    assert len((out / LOG).read_bytes().splitlines()) < 110, "it was killed on its way"


def test_a_killed_run_resumes_to_the_same_bits(street, whole, tmp_path):
    """Killed before the first checkpoint, between two in the RGB stage, and in the instance stage."""
    out = tmp_path / "run"
    killed_after(street, out, 4, resume=False)
    killed_after(street, out, 37, resume=True)
    killed_after(street, out, 95, resume=True)
    finished(started(street, out, resume=True))
    assert_same_run(whole, out)


def test_a_full_disk_is_said_and_loses_nothing(street, tmp_path, monkeypatch):
    """The third checkpoint does not fit: the second stays, and the run goes on from it once there is space."""
    out, saved = tmp_path / "run", []

    def fsync(descriptor):
        if os.readlink(f"/proc/self/fd/{descriptor}").startswith(str(out / f".{CHECKPOINT}")):
            saved.append(1)
            if len(saved) == 3:
                raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(atomic.os, "fsync", fsync)
    with pytest.raises(DataError, match=r"checkpoint.*No space left.*space"):
        run(street, out)
    assert not list(out.glob(".*.tmp"))
    assert not (out / "scene.json").exists()
    run(street, out, resume=True)
    assert_same_run(run(street, tmp_path / "whole"), out)


def test_a_single_time_step_trains(street, tmp_path):
    scene = read_scene_folder(run(street, tmp_path / "run", first_frame=2, last_frame=2))
    assert len(scene) > 100
    assert len(scene.views) == 1
