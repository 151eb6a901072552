"""Jobs from their source to a measured scene, and what becomes of those that are stopped, killed or refused."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image
from small_clip import write_small_clip
from written_street import TINY, copy_street

from instdrive_core.errors import OptionError
from instdrive_core.files.file_lock import FileLock
from instdrive_core.formats.folder.scenes import read_scene_folder
from instdrive_core.jobs import stages as stages_module
from instdrive_core.jobs.job_file import (
    LOCK,
    PICTURE,
    JobRequest,
    ask_job,
    has_job,
    is_job_running,
    locate_job_file,
    read_job_state,
)
from instdrive_core.jobs.run_job import run_job
from instdrive_core.jobs.stages import REPORT, STAGES

PATIENCE = 240.0
"""Seconds to wait for another process, on a busy machine."""
STEPS = 22


@pytest.fixture(scope="module")
def street(tmp_path_factory):
    """Five steps of a small street, of which step 4 is held out."""
    return copy_street(TINY, tmp_path_factory.mktemp("street") / "clip", tmp_path_factory)


@pytest.fixture
def idle(monkeypatch):
    """Stages that do nothing, so that only their order counts; names of those that were worked on."""
    worked = []
    quick = [replace(stage, work=lambda desk, name=stage.name: worked.append(name)) for stage in STAGES]
    monkeypatch.setattr("instdrive_core.jobs.run_job.STAGES", tuple(quick))
    return worked


@pytest.mark.slow
def test_a_drive_that_is_killed_and_stopped_becomes_a_measured_scene(street, tmp_path):
    run, request = tmp_path / "run", JobRequest(str(street), iterations=STEPS)
    killed_in_training(street, run)
    assert not is_job_running(run)
    killed = read_job_state(run)
    assert killed.status == "running"  # a killed process cannot say otherwise

    def stop(state):
        if state.curve != killed.curve:  # it trains, whether or not it did before
            ask_job(run, "stop")

    stopped = run_job(run, request, stop)
    assert stopped.status == "stopped"
    assert stopped.stage.name == "train"
    assert (run / "checkpoint.safetensors").is_file()
    done = run_job(run, request)
    assert done.status == "done"
    assert [stage.name for stage in done.stages if stage.status == "done"] == ["masks", "pace", "train", "eval"]
    assert done.curve[-1].iteration <= STEPS
    scene = read_scene_folder(run)
    assert len(scene.table) > 0
    assert len(scene) == json.loads((run / "eval.json").read_text())["n_gaussians"]
    assert "<html" in (run / REPORT).read_text()
    with Image.open(locate_job_file(run, PICTURE)) as picture:
        assert picture.width == pytest.approx(2 * picture.height * 64 / 36, rel=0.1)  # drawn, and the photo beside it
    assert run_job(run, request) == done  # nothing is done twice


def killed_in_training(street: Path, run: Path) -> None:
    """Begin the job in a process of its own and kill it once it trains."""
    command = [sys.executable, "-m", "instdrive_app.main", "make", str(street), "-o", str(run)]
    process = subprocess.Popen([*command, "--iterations", str(STEPS)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end and process.poll() is None:
        stage = read_job_state(run).stage if has_job(run) else None
        if stage is not None and stage.name == "train":
            break
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    output = process.communicate()[0]
    assert process.returncode == -signal.SIGKILL, output.decode()


def test_stages_are_done_once_and_in_order(idle, tmp_path):
    request = JobRequest(str(write_small_clip(tmp_path / "clip")))
    assert run_job(tmp_path / "run", request).status == "done"
    assert run_job(tmp_path / "run", request).status == "done"
    assert idle == ["masks", "pace", "train", "eval"]


def test_a_stage_that_failed_is_told_and_begun_again(idle, tmp_path, monkeypatch):
    request = JobRequest(str(write_small_clip(tmp_path / "clip")))

    def fail(desk):
        raise OptionError("no memory left")

    broken = tuple(replace(stage, work=fail if stage.name == "train" else lambda desk: None) for stage in STAGES)
    with monkeypatch.context() as patch:
        patch.setattr("instdrive_core.jobs.run_job.STAGES", broken)
        with pytest.raises(OptionError, match="no memory left"):
            run_job(tmp_path / "run", request)
    state = read_job_state(tmp_path / "run")
    assert (state.status, state.problem, state.stage.name) == ("failed", "no memory left", "train")
    assert run_job(tmp_path / "run", request).problem == ""
    assert idle == ["train", "eval"]


def test_a_scene_that_cannot_be_measured_is_done_all_the_same(tmp_path, monkeypatch):
    def refuse(run, progress):
        raise OptionError("no held-out step")

    quick = [replace(stage, work=lambda desk: None) for stage in STAGES if stage.name != "eval"]
    monkeypatch.setattr("instdrive_core.jobs.run_job.STAGES", (*quick, STAGES[-1]))
    monkeypatch.setattr(stages_module, "evaluate_run", refuse)
    state = run_job(tmp_path / "run", JobRequest(str(write_small_clip(tmp_path / "clip"))))
    assert state.status == "done"
    assert "no held-out step" in state.notes[-1]


def test_folders_of_something_else_are_refused(idle, tmp_path):
    clip, other = write_small_clip(tmp_path / "clip"), write_small_clip(tmp_path / "other")
    run_job(tmp_path / "run", JobRequest(str(clip)))
    with pytest.raises(OptionError, match="is a job of"):
        run_job(tmp_path / "run", JobRequest(str(other)))
    with pytest.raises(OptionError, match="is not empty"):
        run_job(other, JobRequest(str(clip)))


def test_one_process_works_on_a_job(idle, tmp_path):
    request = JobRequest(str(write_small_clip(tmp_path / "clip")))
    file = locate_job_file(tmp_path / "run", LOCK)
    file.parent.mkdir(parents=True)
    lock = FileLock.acquire(file)
    with pytest.raises(OptionError, match="another process"):
        run_job(tmp_path / "run", request)
    lock.release()
    assert run_job(tmp_path / "run", request).status == "done"
