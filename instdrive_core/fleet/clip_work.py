"""The work on one clip, in whatever process it is done: the job of ``instdrive make``, then the recording."""

from __future__ import annotations

import hashlib
import json
import os
import socket
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from instdrive_core.errors import InstDriveError, OptionError
from instdrive_core.extras import explain_missing_module
from instdrive_core.files.atomic import write_bytes
from instdrive_core.fleet.plan import ClipWishes, FleetClip, is_address
from instdrive_core.fleet.transfer import RunMirror, fetch_source
from instdrive_core.jobs.job_file import JobRequest, JobState, is_job_running
from instdrive_core.jobs.run_job import run_job
from instdrive_core.recording.drive import open_drive
from instdrive_core.recording.folder import MANIFEST
from instdrive_core.recording.plan import RecordOptions
from instdrive_core.recording.record import record_drive

RECORDING, WORKER = "recording", "fleet_worker.json"
_PATIENCE = 90.0
"""Seconds that a dying worker of an earlier driver is waited for."""


@dataclass(frozen=True)
class ClipTask:
    """One attempt at a clip."""

    clip: FleetClip
    wishes: ClipWishes
    runs: str
    """Folder or address of all runs."""
    scratch: str
    """Folder of the worker's machine for what has an address."""
    token: str
    """Tells attempts apart."""


@dataclass(frozen=True)
class ClipOutcome:
    """How an attempt ended."""

    status: Literal["done", "stopped", "failed"]
    problem: str = ""
    """Why it failed."""
    may_repeat: bool = False
    """Whether another attempt may end otherwise: not where the clip or an option is at fault."""


def work_on_clip(task: ClipTask) -> ClipOutcome:
    """Do what is left of a clip, and say how that ended; raises nothing but what ends the process."""
    try:
        return _work_on(task)
    except KeyboardInterrupt:
        return ClipOutcome("stopped")
    except ModuleNotFoundError as error:
        return ClipOutcome("failed", str(explain_missing_module(error) or error))
    except InstDriveError as error:
        return ClipOutcome("failed", str(error))
    except Exception as error:
        return ClipOutcome("failed", f"{type(error).__name__}: {error}", may_repeat=True)


def _work_on(task: ClipTask) -> ClipOutcome:
    clip, wishes = task.clip, task.wishes
    scratch = Path(task.scratch)
    mirror: RunMirror | None = None
    run = Path(task.runs) / clip.name
    if is_address(task.runs):
        run = scratch / "runs" / _shorten(task.runs) / clip.name
        mirror = RunMirror(f"{task.runs}/{clip.name}", run)
    _wait_until_free(run)
    if mirror is not None:
        mirror.fetch()
    facts = {"token": task.token, "host": socket.gethostname(), "pid": os.getpid(), "began": time.time()}
    write_bytes(run / "job" / WORKER, json.dumps(facts).encode())
    if mirror is not None:
        mirror.send(now=True)
    source = clip.source
    if is_address(source):
        source = str(fetch_source(source, scratch / "clips" / _shorten(source)))
    shown: list[str] = []

    def show(state: JobState) -> None:
        if mirror is not None:
            stage = "" if state.stage is None else state.stage.name
            mirror.send(now=shown[-1:] != [stage])
            shown[:] = [stage]

    request = JobRequest(source, wishes.minutes, wishes.iterations, wishes.evaluate, wishes.checkpoint_every)
    try:
        state = run_job(run, request, show)
        if state.status == "done" and wishes.record and not (run / RECORDING / MANIFEST).is_file():
            record_drive(run / RECORDING, open_drive(run, RecordOptions()))
    finally:
        if mirror is not None:
            mirror.send(now=True)
    return ClipOutcome("done" if state.status == "done" else "stopped")


def _wait_until_free(run: Path) -> None:
    """Wait for a worker whose driver was killed: it ends by itself, but not at once."""
    end = time.monotonic() + _PATIENCE
    while is_job_running(run):
        if time.monotonic() > end:
            raise OptionError(f"{run}: another process works on this clip. Wait for it, or stop it first.")
        time.sleep(0.5)


def _shorten(address: str) -> str:
    return hashlib.sha256(address.encode()).hexdigest()[:12]
