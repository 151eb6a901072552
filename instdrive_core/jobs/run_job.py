"""Runs a job from where it stands to its end."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from instdrive_core.errors import InstDriveError, OptionError
from instdrive_core.extras import explain_missing_module
from instdrive_core.files.file_lock import FileLock
from instdrive_core.jobs.desk import JobDesk, JobStoppedError
from instdrive_core.jobs.find_stages import FINDING_STAGES, plan_finding_stages
from instdrive_core.jobs.improve_stages import IMPROVING_STAGES, check_improving, plan_improving_stages
from instdrive_core.jobs.job_file import (
    FOLDER,
    LOCK,
    JobRequest,
    JobState,
    ask_job,
    has_job,
    locate_job_file,
    read_job_state,
)
from instdrive_core.jobs.source import look_at_source
from instdrive_core.jobs.stages import STAGES, plan_stages


def run_job(run: Path, request: JobRequest, on_change: Callable[[JobState], None] = lambda state: None) -> JobState:
    """Run a job in its folder, or go on with it where it was stopped or killed; returns its last state.

    Whoever wants it to hold or to stop calls `job_file.ask_job`; SIGINT and SIGTERM stop it, too.

    Raises OptionError where the folder holds something else, another job, or one that a process works on; what a
    stage raises where that fails, after the state says so.
    """
    state = _open_state(run, request)
    (run / FOLDER).mkdir(parents=True, exist_ok=True)
    lock = FileLock.acquire(locate_job_file(run, LOCK))
    if lock is None:
        raise OptionError(f"{run}: another process works on this job. Wait for it, or stop it first.")
    try:
        ask_job(run, "run")
        desk = JobDesk(run, state, on_change)
        with _stopped_by_signals(desk):
            return _work(desk)
    finally:
        lock.release()


def _open_state(run: Path, request: JobRequest) -> JobState:
    if has_job(run):
        state = read_job_state(run)
        if (state.request.kind, state.request.source) != (request.kind, request.source):
            raise OptionError(
                f"{run}: is a job of {state.request.source}, not of {request.source}. Choose another --out."
            )
        return state
    if run.is_dir() and any(entry.name != FOLDER for entry in run.iterdir()):
        raise OptionError(f"{run} is not empty and no job that `{request.kind}` began. Choose another --out.")
    if request.kind == "improve":
        check_improving(Path(request.source), request.clip)
        return JobState(request, stages=plan_improving_stages(request.evaluate))
    if request.kind == "find-objects":
        return JobState(request, stages=plan_finding_stages(request))
    facts = look_at_source(Path(request.source))
    if facts.problem:
        raise OptionError(f"{request.source}: {facts.problem}")
    return JobState(request, stages=plan_stages(facts, request.evaluate))


def _work(desk: JobDesk) -> JobState:
    desk.change(now=True, status="running", problem="")
    kinds = {"make": STAGES, "improve": IMPROVING_STAGES, "find-objects": FINDING_STAGES}
    works = {stage.name: stage.work for stage in kinds[desk.state.request.kind]}
    try:
        for stage in desk.state.stages:
            if stage.status != "done":
                desk.begin(stage.name)
                works[stage.name](desk)
                desk.end(stage.name)
    except JobStoppedError:
        desk.change(now=True, status="stopped", seconds_left=None)
        return desk.state
    except BaseException as error:
        desk.change(now=True, status="failed", problem=_describe(error), seconds_left=None)
        raise
    desk.change(now=True, status="done", doing="")
    return desk.state


def _describe(error: BaseException) -> str:
    if isinstance(error, ModuleNotFoundError):
        return str(explain_missing_module(error) or error)
    return str(error) if isinstance(error, InstDriveError) else f"{type(error).__name__}: {error}"


@contextmanager
def _stopped_by_signals(desk: JobDesk) -> Iterator[None]:
    """Let the first SIGINT or SIGTERM stop the job at its next report; a second one ends the process at once."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    kinds = (signal.SIGINT, signal.SIGTERM)
    before = {kind: signal.getsignal(kind) for kind in kinds}

    def stop(kind: int, frame: object) -> None:
        desk.is_stopping = True
        for other in kinds:
            signal.signal(other, before[other])

    for kind in kinds:
        signal.signal(kind, stop)
    try:
        yield
    finally:
        for kind in kinds:
            signal.signal(kind, before[kind])
