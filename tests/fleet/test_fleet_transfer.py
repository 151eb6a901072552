"""Clips and runs that have an address."""

import pytest
from small_clip import write_small_clip

from instdrive_core.errors import DataError
from instdrive_core.fleet import clip_work
from instdrive_core.fleet.clip_work import ClipTask, work_on_clip
from instdrive_core.fleet.figures import is_clip_finished, read_worker_token
from instdrive_core.fleet.place import open_place
from instdrive_core.fleet.plan import ClipWishes, plan_fleet
from instdrive_core.fleet.transfer import RunMirror, fetch_source
from instdrive_core.jobs.job_file import JobState, write_job_state

fsspec = pytest.importorskip("fsspec")


@pytest.fixture
def memory(tmp_path):
    """A file system in memory with a folder of this test."""
    system = fsspec.filesystem("memory")
    yield system, f"memory://{tmp_path.name}"
    system.rm(f"/{tmp_path.name}", recursive=True)


def test_a_clip_is_fetched_once(memory, tmp_path):
    system, address = memory
    clip = write_small_clip(tmp_path / "clip")
    system.put(str(clip), f"/{tmp_path.name}/clip", recursive=True)
    there = fetch_source(f"{address}/clip", tmp_path / "scratch")
    assert there.name == "clip"
    names = {file.relative_to(clip) for file in clip.rglob("*") if file.is_file()}
    assert {file.relative_to(there) for file in there.rglob("*") if file.is_file()} == names
    assert all((clip / name).read_bytes() == (there / name).read_bytes() for name in names)
    system.rm(f"/{tmp_path.name}/clip", recursive=True)
    system.pipe_file(f"/{tmp_path.name}/keep", b"")
    assert fetch_source(f"{address}/clip", tmp_path / "scratch") == there


def test_one_file_is_fetched(memory, tmp_path):
    system, address = memory
    system.pipe_file(f"/{tmp_path.name}/drive.mp4", b"film")
    assert fetch_source(f"{address}/drive.mp4", tmp_path / "scratch").read_bytes() == b"film"


def test_nothing_at_an_address_is_told(memory, tmp_path):
    system, address = memory
    system.pipe_file(f"/{tmp_path.name}/other", b"")
    with pytest.raises(DataError, match=r"clip: was not found"):
        fetch_source(f"{address}/clip", tmp_path / "scratch")


def test_a_run_goes_on_on_another_machine(memory, tmp_path):
    system, address = memory
    one, two = RunMirror(f"{address}/run", tmp_path / "one"), RunMirror(f"{address}/run", tmp_path / "two")
    (tmp_path / "one" / "job").mkdir(parents=True)
    (tmp_path / "one" / "checkpoint.safetensors").write_bytes(b"step 100")
    (tmp_path / "one" / "job" / "lock").touch()
    assert one.send(now=True)
    (tmp_path / "one" / "checkpoint.safetensors").write_bytes(b"step 2000")
    assert not one.send()  # not yet due
    two.fetch()
    assert (tmp_path / "two" / "checkpoint.safetensors").read_bytes() == b"step 100"
    assert not (tmp_path / "two" / "job" / "lock").exists()
    one.send(now=True)
    assert system.cat_file(f"/{tmp_path.name}/run/checkpoint.safetensors") == b"step 2000"


def test_a_clip_and_its_runs_have_addresses(memory, tmp_path, monkeypatch):
    system, address = memory
    system.put(str(write_small_clip(tmp_path / "clip")), f"/{tmp_path.name}/clip", recursive=True)
    asked = []

    def finish(run, request, on_change):
        asked.append(request)
        state = JobState(request, "done")
        write_job_state(run, state)
        on_change(state)
        return state

    monkeypatch.setattr(clip_work, "run_job", finish)
    (clip,), place = plan_fleet([f"{address}/clip"]), open_place(f"{address}/runs")
    task = ClipTask(clip, ClipWishes(iterations=7), place.root, str(tmp_path / "scratch"), "token")
    assert work_on_clip(task).status == "done"
    assert asked[0].source.startswith(str(tmp_path / "scratch"))
    assert asked[0].iterations == 7
    assert is_clip_finished(place, clip, task.wishes)
    assert not is_clip_finished(place, clip, ClipWishes(record=True))
    assert read_worker_token(place, clip) == "token"


def test_a_clip_at_fault_is_not_tried_again_and_a_lost_disk_is(tmp_path, monkeypatch):
    (clip,) = plan_fleet([str(tmp_path / "nowhere")])
    task = ClipTask(clip, ClipWishes(), str(tmp_path / "runs"), "", "token")
    outcome = work_on_clip(task)
    assert (outcome.status, outcome.may_repeat) == ("failed", False)
    assert "was not found" in outcome.problem

    def break_down(run, request, on_change):
        raise OSError("disk gone")

    monkeypatch.setattr(clip_work, "run_job", break_down)
    outcome = work_on_clip(task)
    assert (outcome.problem, outcome.may_repeat) == ("OSError: disk gone", True)
