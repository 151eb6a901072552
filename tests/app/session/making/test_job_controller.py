"""The editor and the job that makes a scene: beginning, following, holding, leaving, and finding it again."""

import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from session_driver import errors, finish
from small_clip import write_small_clip

from instdrive_app.session.making import job_controller
from instdrive_app.session.making.child import CommandFailedError, clean_complaint, run_command
from instdrive_app.session.making.job_controller import find_out_problem
from instdrive_app.session.requests import AskLeaveJob, OfferJob, ShowPanel
from instdrive_core.files.file_lock import FileLock
from instdrive_core.jobs.job_file import (
    LOCK,
    JobRequest,
    JobStage,
    JobState,
    ask_job,
    locate_job_file,
    read_wish,
    write_job_state,
)

TRAINING = JobState(JobRequest("/photos"), stages=(JobStage("train", "Training", "running", 0.5),))
DONE = replace(TRAINING, status="done", stages=(JobStage("train", "Training", "done", 1.0),))
WAITS = [sys.executable, "-c", "import time; time.sleep(600)"]


@pytest.fixture
def making(session, tmp_path, monkeypatch):
    """The session's job controller, which knows no earlier job and looks at its files in every frame."""
    monkeypatch.setattr(job_controller, "_LOOK_SECONDS", 0.0)
    session.making.known.clear()
    session.files.recents.clear()
    yield session.making
    session.making.known.clear()


@pytest.fixture
def started(monkeypatch):
    """Commands that were to be started; processes that only wait stand for them."""
    commands, processes = [], []

    def start(output, *arguments):
        commands.append(arguments)
        processes.append(subprocess.Popen(WAITS))
        return processes[-1]

    monkeypatch.setattr(job_controller, "start_command", start)
    yield commands
    for process in processes:
        process.kill()
        process.wait()


@pytest.fixture
def running(tmp_path):
    """The folder of a job that another process works on, and what ends that."""
    run = tmp_path / "elsewhere"
    write_job_state(run, TRAINING)
    lock = FileLock.acquire(locate_job_file(run, LOCK))
    yield run, lock.release
    lock.release()


def requests(session):
    """What was asked for about jobs since the last call."""
    kinds = (ShowPanel, OfferJob, AskLeaveJob)
    return [request for kind in kinds if (request := session.requests.take(kind)) is not None]


def test_a_source_is_looked_at_in_a_process_of_its_own(session, making, tmp_path):
    clip = write_small_clip(tmp_path / "clip")
    making.look_at(clip)
    assert not making.look.is_ready
    finish(session)
    assert (making.look.title, making.look.problem) == ("PandaSet clip", "")
    assert "LiDAR" in dict(making.look.facts)


def test_what_no_scene_can_be_made_of_is_told_at_the_source(session, making, tmp_path):
    (tmp_path / "notes").mkdir()
    making.look_at(tmp_path / "notes")
    finish(session)
    assert making.look.is_ready
    assert "no folder of photos" in making.look.problem
    assert errors(session) == []


def test_a_job_is_begun_in_a_process_of_its_own(session, making, started, tmp_path):
    making.begin(Path("/photos"), tmp_path / "run", 7.5)
    assert started == [("make", "/photos", "--out", str(tmp_path / "run"), "--minutes", "7.5")]
    assert making.is_running
    assert requests(session) == [ShowPanel("Training")]
    making.begin(Path("/others"), tmp_path / "run2", 5.0)
    assert len(started) == 1
    assert "is running" in errors(session)[0]


def test_a_running_job_is_held_and_goes_on(making, running):
    run, _ = running
    making.follow(run)
    assert making.is_running
    making.ask("pause")
    assert read_wish(run) == "pause"
    making.go_on()
    assert read_wish(run) == "run"


def test_a_job_that_ends_opens_its_scene(session, making, running, monkeypatch):
    run, end = running
    opened = []
    monkeypatch.setattr(session.files, "leave_for", opened.append)
    making.follow(run)
    session.tick(0.0)
    assert opened == []
    write_job_state(run, DONE)
    end()
    session.tick(0.0)
    session.tick(0.0)
    assert opened == [run]


def test_a_failed_job_says_why_and_can_go_on(session, making, running, started):
    run, end = running
    making.follow(run)
    write_job_state(run, replace(TRAINING, status="failed", problem="no memory left"))
    end()
    session.tick(0.0)
    assert errors(session) == ["elsewhere: no memory left"]
    assert making.is_interrupted
    making.go_on()
    assert started == [("make", "/photos", "--out", str(run))]


def test_a_job_that_could_not_begin_is_told_and_forgotten(session, making, tmp_path, monkeypatch):
    def start(output, *arguments):
        output.parent.mkdir(parents=True)
        output.write_text("some note\ninstdrive make: /photos was not found. Check the path\n")
        return subprocess.Popen([sys.executable, "-c", "raise SystemExit(1)"])

    monkeypatch.setattr(job_controller, "start_command", start)
    making.begin(Path("/photos"), tmp_path / "run", 5.0)
    end = time.monotonic() + 60
    while making.run is not None and time.monotonic() < end:
        session.tick(0.0)
    assert errors(session) == ["run: /photos was not found. Check the path"]


def test_closing_asks_only_while_a_job_runs(session, making, running):
    run, _ = running
    session.leave()
    assert session.is_quitting
    session.is_quitting = False
    making.follow(run)
    session.leave()
    assert not session.is_quitting
    (request,) = requests(session)
    assert isinstance(request, AskLeaveJob)
    request.then()
    assert session.is_quitting


def test_a_job_that_goes_on_is_found_again(session, making, running):
    run, _ = running
    making.known.add(run)
    making.offer_unfinished()
    assert (making.run, making.is_running) == (run, True)
    assert requests(session) == [ShowPanel("Training")]


def test_a_killed_job_is_offered_to_go_on(session, making, tmp_path):
    write_job_state(tmp_path / "run", TRAINING)
    making.known.add(tmp_path / "run")
    making.offer_unfinished()
    assert requests(session) == [OfferJob(tmp_path / "run")]
    assert making.is_interrupted


def test_a_job_that_the_user_stopped_is_shown_and_not_asked_about(session, making, tmp_path):
    write_job_state(tmp_path / "run", replace(TRAINING, status="stopped"))
    making.known.add(tmp_path / "run")
    making.offer_unfinished()
    assert requests(session) == [ShowPanel("Training")]


def test_a_job_done_meanwhile_is_shown_until_its_scene_was_opened(session, making, tmp_path):
    write_job_state(tmp_path / "run", DONE)
    making.known.add(tmp_path / "run")
    making.offer_unfinished()
    assert requests(session) == [ShowPanel("Training")]
    making.forget()
    session.files.recents.add(tmp_path / "run")
    making.offer_unfinished()
    assert making.run is None


def test_the_report_is_one_click_away(session, making, tmp_path, monkeypatch):
    pages = []
    monkeypatch.setattr(job_controller.webbrowser, "open", lambda page: not pages.append(page))
    write_job_state(tmp_path / "run", DONE)
    making.follow(tmp_path / "run")
    making.open_report()
    assert "There is no page" in errors(session)[0]
    (tmp_path / "run" / "report.html").write_text("<html>")
    (tmp_path / "run" / "eval.json").write_text('{"psnr": 24.5}')
    making.open_report()
    assert pages == [(tmp_path / "run" / "report.html").as_uri()]
    session.tick(0.0)
    assert making.figures == {"psnr": 24.5}


def test_folders_that_hold_something_are_no_place_for_a_job(tmp_path):
    clip = write_small_clip(tmp_path / "clip")
    assert find_out_problem(tmp_path / "new", clip) == ""
    assert "not empty" in find_out_problem(clip, clip)
    (tmp_path / "file").write_text("")
    assert "file of this name" in find_out_problem(tmp_path / "file", clip)
    write_job_state(tmp_path / "run", replace(TRAINING, request=JobRequest(str(clip))))
    ask_job(tmp_path / "run", "stop")
    assert find_out_problem(tmp_path / "run", clip) == ""
    assert "another job" in find_out_problem(tmp_path / "run", tmp_path)


def test_what_a_command_complained_of_is_its_last_line():
    with pytest.raises(CommandFailedError, match="was not found"):
        run_command("make", "/nowhere/at/all", "--look")
    assert clean_complaint("note\ninstdrive make: no room\n") == "no room"
    assert clean_complaint("") == "The command ended without a word"
