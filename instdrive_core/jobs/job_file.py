"""A job as files: its state, which the job writes and others read, and what others ask of it.

Everything is in ``job/`` below the folder of the run, so that a job can be watched, stopped and taken up again by a
program that did not start it. Nothing here imports what a job works with.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Literal

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import write_bytes
from instdrive_core.files.file_lock import FileLock
from instdrive_core.files.json_fields import read_json, require_field
from instdrive_core.wording import phrase

FOLDER, STATE, WISH, LOCK, PICTURE, LOG = "job", "state.json", "wish", "lock", "picture.jpg", "output.txt"
EDITS = "edits.instdrive"
"""A project of the edits that a scene is trained on with, as they were when the job was begun."""
VERSION = 1
Status = Literal["running", "paused", "stopped", "failed", "done"]
StageStatus = Literal["waiting", "running", "done"]
Wish = Literal["run", "pause", "stop"]
JobKind = Literal["make", "improve", "find-objects"]
UNFINISHED: tuple[Status, ...] = ("running", "paused", "stopped", "failed")
"""States from which a job can go on, once no process runs it."""


@dataclass(frozen=True)
class JobRequest:
    """What a job makes, of what, and how long it may take."""

    source: str
    """Video, folder of photos, or folder of a data set; of kind ``improve``, a run or a project on one; of kind
    ``find-objects``, a scene or a project. Absolute."""
    minutes: float = 20.0
    """Minutes that the whole job may take on this machine."""
    iterations: int | None = None
    """Training steps; None = as many as the minutes allow."""
    evaluate: bool = True
    checkpoint_every: int | None = None
    """Training steps between checkpoints; None = as usual."""
    kind: JobKind = "make"
    """Whether a scene is made, one is trained on, or its objects are found; it is the name of the command, too."""
    clip: str = ""
    """Photos and poses of a scene that is there: where the clip that its run names has moved to, or those that objects
    are found in; empty = as the scene says."""
    masks: str = ""
    """Masks in which objects are found: a folder, or the name of a source that makes them; empty = the best."""
    replaces: bool = False
    """Whether objects that are found replace the scene's instances."""


@dataclass(frozen=True)
class JobStage:
    """One stage of a job, in order."""

    name: str
    title: str
    status: StageStatus = "waiting"
    share: float | None = None
    """Share that is done, 0 … 1; None where that is unknown."""
    seconds: float = 0.0
    """Spent so far, interruptions left out."""


@dataclass(frozen=True)
class CurvePoint:
    """Progress of the training at one of its steps."""

    stage: str
    iteration: int
    loss: float
    psnr: float | None
    """PSNR of a training photo, dB; None where no photo is drawn."""


@dataclass(frozen=True)
class JobState:
    """Everything that a user is shown of a job."""

    request: JobRequest
    status: Status = "running"
    stages: tuple[JobStage, ...] = ()
    doing: str = ""
    """Words on what is done right now."""
    seconds_left: float | None = None
    """What the running stage still needs; None while that cannot be told."""
    iterations: int | None = None
    """Training steps that were chosen; None before that."""
    curve: tuple[CurvePoint, ...] = ()
    notes: tuple[str, ...] = ()
    """What the user should know, oldest first."""
    problem: str = ""
    """Why the job failed; empty otherwise."""
    pictures: int = 0
    """Pictures written so far: a new number means a new picture in the file."""

    @property
    def stage(self) -> JobStage | None:
        """The stage that runs or was interrupted; None where all are done or none was begun."""
        return next((stage for stage in self.stages if stage.status == "running"), None)


def locate_job_file(run: Path, name: str) -> Path:
    """Locate one of a job's files, e.g. `STATE`."""
    return run / FOLDER / name


def locate_project(run: Path) -> Path:
    """Locate the project with the edits of a scene that was trained on; there is none where it had no edits."""
    return run / f"{run.resolve().name}.instdrive"


def has_job(run: Path) -> bool:
    """Whether a folder is that of a job."""
    return locate_job_file(run, STATE).is_file()


def write_job_state(run: Path, state: JobState) -> None:
    """Write a job's state, whole or not at all."""
    content = {"version": VERSION, **asdict(state)}
    write_bytes(locate_job_file(run, STATE), (json.dumps(content) + "\n").encode())


def read_job_state(run: Path) -> JobState:
    """Read a job's state. Raises DataError where there is none or the file is damaged."""
    file = locate_job_file(run, STATE)
    content = read_json(file)
    if require_field(file, content, "version") != VERSION:
        raise DataError(file, f"has version {content['version']!r}, not {VERSION}", "Begin the job in another folder")
    try:
        values = {name.name: require_field(file, content, name.name) for name in fields(JobState)}
        return JobState(
            **{
                **values,
                "request": JobRequest(**values["request"]),
                "stages": tuple(JobStage(**stage) for stage in values["stages"]),
                "curve": tuple(CurvePoint(**point) for point in values["curve"]),
                "notes": tuple(values["notes"]),
            }
        )
    except TypeError as error:
        raise DataError(file, f"is damaged ({error})", "Begin the job in another folder") from error


def ask_job(run: Path, wish: Wish) -> None:
    """Ask a job to go on, to hold, or to stop where it can go on later; it follows within a few steps."""
    write_bytes(locate_job_file(run, WISH), wish.encode())


def read_wish(run: Path) -> Wish:
    """Read what was asked of a job last: ``run`` unless somebody asked otherwise."""
    try:
        asked = locate_job_file(run, WISH).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return "run"
    return "pause" if asked == "pause" else "stop" if asked == "stop" else "run"


def is_job_running(run: Path) -> bool:
    """Whether a process works on a job at this moment, however it was started."""
    file = locate_job_file(run, LOCK)
    if not file.is_file():
        return False
    lock = FileLock.acquire(file)
    if lock is None:
        return True
    lock.release()
    return False


def describe_seconds(seconds: float) -> str:
    """Write a duration as people say it: ``40 s``, ``12 min``, ``1 h 20 min``."""
    if seconds < 90:
        return phrase("{seconds} s", seconds=max(round(seconds), 1))
    minutes = round(seconds / 60)
    if minutes < 90:
        return phrase("{minutes} min", minutes=minutes)
    return phrase("{hours} h {minutes} min", hours=minutes // 60, minutes=minutes % 60)
