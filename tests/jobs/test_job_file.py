"""A job's files: its state, what is asked of it, and whether a process works on it."""

import json

import pytest

from instdrive_core.errors import DataError
from instdrive_core.files.file_lock import FileLock
from instdrive_core.jobs.job_file import (
    LOCK,
    STATE,
    WISH,
    CurvePoint,
    JobRequest,
    JobStage,
    JobState,
    ask_job,
    describe_seconds,
    has_job,
    is_job_running,
    locate_job_file,
    read_job_state,
    read_wish,
    write_job_state,
)

STATE_OF_TRAINING = JobState(
    JobRequest("/photos", minutes=7.5),
    stages=(JobStage("masks", "Masks", "done", 1.0, 3.5), JobStage("train", "Training", "running", 0.25)),
    doing="step 10",
    seconds_left=12.5,
    iterations=900,
    curve=(CurvePoint("rgb", 10, 0.5, 17.25), CurvePoint("instances", 10, 0.25, None)),
    notes=("12 masks",),
    pictures=2,
)


def test_a_state_is_read_as_it_was_written(tmp_path):
    assert not has_job(tmp_path)
    write_job_state(tmp_path, STATE_OF_TRAINING)
    assert has_job(tmp_path)
    assert read_job_state(tmp_path) == STATE_OF_TRAINING
    assert read_job_state(tmp_path).stage.name == "train"


@pytest.mark.parametrize(
    ("field", "value", "complaint"),
    [("version", 99, "version"), ("stages", [{"color": "red"}], "damaged"), ("request", {"size": 2}, "damaged")],
)
def test_a_damaged_state_is_told(tmp_path, field, value, complaint):
    write_job_state(tmp_path, STATE_OF_TRAINING)
    file = locate_job_file(tmp_path, STATE)
    file.write_text(json.dumps({**json.loads(file.read_text()), field: value}))
    with pytest.raises(DataError, match=complaint):
        read_job_state(tmp_path)


def test_what_was_asked_last_counts_and_nonsense_means_go_on(tmp_path):
    assert read_wish(tmp_path) == "run"
    for wish in ("pause", "stop", "run"):
        ask_job(tmp_path, wish)
        assert read_wish(tmp_path) == wish
    locate_job_file(tmp_path, WISH).write_bytes(b"\xff\xfe")
    assert read_wish(tmp_path) == "run"


def test_a_job_runs_while_its_lock_is_held(tmp_path):
    assert not is_job_running(tmp_path)
    file = locate_job_file(tmp_path, LOCK)
    file.parent.mkdir()
    lock = FileLock.acquire(file)
    assert is_job_running(tmp_path)
    lock.release()
    assert not is_job_running(tmp_path)


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.2, "1 s"), (42.4, "42 s"), (95, "2 min"), (3599, "60 min"), (5400, "1 h 30 min")]
)
def test_durations_read_as_people_say_them(seconds, text):
    assert describe_seconds(seconds) == text
