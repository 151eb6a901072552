"""The job that makes a scene, trains one on, or finds its objects: begun here, run elsewhere, watched here again."""

from __future__ import annotations

import json
import os.path
import subprocess
import time
import webbrowser
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from instdrive_app.messages import read_error
from instdrive_app.session.context import SessionContext
from instdrive_app.session.files.document_files import DocumentFiles
from instdrive_app.session.files.recents import RecentFiles
from instdrive_app.session.making.child import CommandFailedError, clean_complaint, run_command, start_command
from instdrive_app.session.requests import AskLeaveJob, OfferJob, ShowPanel
from instdrive_core.errors import DataError
from instdrive_core.files.user_folders import find_state_folder
from instdrive_core.jobs.job_file import (
    LOG,
    UNFINISHED,
    JobKind,
    JobState,
    Wish,
    ask_job,
    has_job,
    is_job_running,
    locate_job_file,
    locate_project,
    read_job_state,
)
from instdrive_core.wording import phrase

PANEL = "Training"
"""Title of the panel that shows the job."""
REPORT, FIGURES = "report.html", "eval.json"
_LOOK_SECONDS = 0.5
"""Least time between two looks at the job's files."""


@dataclass(frozen=True)
class SourceLook:
    """What was found out about a source that a scene is to be made of."""

    source: Path
    title: str = ""
    facts: tuple[tuple[str, str], ...] = ()
    problem: str = ""
    """Why no scene can be made of it; empty where one can."""
    is_ready: bool = False
    """Whether the look is over."""
    mask_plans: tuple[str, ...] = ()
    """Where its masks can come from, the best first, as `SourceFacts` names it."""


class JobController:
    """Begins, watches, holds and ends one job at a time. A job runs on when the editor closes."""

    def __init__(self, context: SessionContext, files: DocumentFiles) -> None:
        self._context, self._files = context, files
        self._process: subprocess.Popen[bytes] | None = None
        self._looked = 0.0
        self._is_alive = False
        self.known = RecentFiles(find_state_folder() / "jobs.json")
        """Folders of jobs, newest first."""
        self.run: Path | None = None
        """Folder of the job that is shown; None where there was none yet."""
        self.state: JobState | None = None
        """State of that job; None until its process has written one."""
        self.figures: dict[str, Any] = {}
        """Figures of the evaluation of the job's run; empty before that."""
        self.openers: dict[JobKind, Callable[[Path], None]] = {}
        """What opens the result of a job, by its kind, from the job's folder; set by those that know the edits made
        since. What is not listed is opened as `find_result` says."""
        self.look: SourceLook | None = None
        """What is known of the source chosen last."""

    @property
    def is_running(self) -> bool:
        """Whether a process works on the job, or holds."""
        return self._is_alive

    @property
    def is_interrupted(self) -> bool:
        """Whether the job can go on and no process works on it."""
        return self.state is not None and self.state.status in UNFINISHED and not self._is_alive

    def look_at(self, source: Path, command: Sequence[str] | None = None) -> None:
        """Find out in the background what a source is; `look` tells.

        `command` finds it out, and prints it as JSON; by default it is the one that looks at what a scene is made of.
        """
        arguments = ("make", str(source), "--look") if command is None else command
        self.look = SourceLook(source)

        def keep(answer: str) -> None:
            found = json.loads(answer)
            facts = tuple((label, text) for label, text in found["facts"])
            plans = tuple(found["mask_plans"])
            self._keep_look(SourceLook(source, found["title"], facts, found["problem"], True, plans))

        def keep_problem(error: BaseException) -> bool:
            self._keep_look(SourceLook(source, problem=read_error(error), is_ready=True))
            return isinstance(error, CommandFailedError)

        self._context.jobs.submit_in_background(
            "Looking at photos", lambda: run_command(*arguments), keep, keep_problem
        )

    def begin(self, source: Path, run: Path, minutes: float) -> None:
        """Begin a job in a folder; one that it holds goes on."""
        self._start(run, "make", str(source), "--out", str(run), "--minutes", f"{minutes:g}")

    def begin_improving(self, source: Path, run: Path, minutes: float) -> None:
        """Begin to train a run or project on in a folder that holds its edits."""
        self._start(run, "improve", str(source), "--out", str(run), "--minutes", f"{minutes:g}")

    def begin_finding(self, source: Path, run: Path, arguments: Sequence[str]) -> None:
        """Begin to find the objects of a scene or project in a folder that holds its edits.

        `arguments` are further ones of the command.
        """
        self._start(run, "find-objects", str(source), "--out", str(run), *arguments)

    def go_on(self) -> None:
        """Let the job go on, whether it holds, was stopped or was killed."""
        if self.run is None or self.state is None:
            return
        if self._is_alive:
            self.ask("run")
        else:
            self._start(self.run, self.state.request.kind, self.state.request.source, "--out", str(self.run))

    def ask(self, wish: Wish) -> None:
        """Ask the running job to hold, to go on or to stop; it does so within a few steps."""
        if self.run is None:
            return
        try:
            ask_job(self.run, wish)
        except DataError as error:
            self._context.messages.error(read_error(error))

    def follow(self, run: Path) -> None:
        """Show a job that was begun before, whether or not it runs."""
        self.run, self.state, self._process, self._is_alive = run, None, None, False
        self._update()

    def forget(self) -> None:
        """Show no job any more; its files stay."""
        self.run, self.state, self._process, self._is_alive = None, None, None, False

    def offer_unfinished(self) -> None:
        """Show the newest job of an earlier editor that runs, is not done, or that nobody has seen done.

        The user is asked about one whose process was killed.
        """
        run = next((run for run in self.known.paths if _read_state(run) is not None), None)
        if run is None or {run, find_result(run)} & set(self._files.recents.paths):
            return
        self.follow(run)
        if self.is_interrupted and self.state is not None and self.state.status in ("running", "paused"):
            self._context.requests.put(OfferJob(run))
            return
        if self.state is not None and self.state.status == "done":
            self._context.messages.info(phrase("{name} is done", name=run.name))
        self._context.requests.put(ShowPanel(PANEL))

    def leave(self, then: Callable[[], None]) -> None:
        """Do what closes the editor, `then`; where a job runs, the user is asked first what becomes of it."""
        self._update()
        if self._is_alive:
            self._context.requests.put(AskLeaveJob(then))
        else:
            then()

    def open_scene(self) -> None:
        """Open what the job made."""
        if self.run is None:
            return
        opener = None if self.state is None else self.openers.get(self.state.request.kind)
        if opener is not None:
            opener(self.run)
        else:
            self._files.leave_for(find_result(self.run))

    def open_report(self) -> None:
        """Show the evaluation of the job's run in the browser."""
        if self.run is not None:
            self.open_page(self.run / REPORT)

    def open_page(self, page: Path) -> None:
        """Show a page in the browser, and say where it is."""
        if not page.is_file():
            self._context.messages.error(phrase("There is no page {page}", page=page))
            return
        if not webbrowser.open(page.resolve().as_uri()):
            self._context.messages.info(phrase("No browser was found. The page is {page}", page=page))

    def tick(self) -> None:
        """Look now and then how the job is doing; called once a frame."""
        if self.run is not None and time.monotonic() - self._looked > _LOOK_SECONDS:
            self._update()

    def _start(self, run: Path, *arguments: str) -> None:
        self._update()
        if self._is_alive:
            self._context.messages.error("A job is running; wait for it, or stop it first")
            return
        try:
            process = start_command(locate_job_file(run, LOG), *arguments)
        except OSError as error:
            self._context.messages.error(
                phrase("{run}: the job cannot be begun ({error})", run=run, error=error.strerror or error)
            )
            return
        self.run, self.state, self._process, self._is_alive = run, None, process, True
        self.known.add(run)
        self._context.requests.put(ShowPanel(PANEL))

    def _update(self) -> None:
        self._looked = time.monotonic()
        if self.run is None:
            return
        was_alive = self._is_alive
        ended = self._process is None or self._process.poll() is not None
        self._is_alive = not ended or is_job_running(self.run)
        self.state = _read_state(self.run)
        is_done = self.state is not None and self.state.status == "done"
        self.figures = (self.figures or read_figures(self.run)) if is_done else {}
        if was_alive and not self._is_alive:
            self._tell_end(self.run)

    def _tell_end(self, run: Path) -> None:
        messages, state = self._context.messages, self.state
        if state is not None and state.status == "done":
            if state.request.kind != "find-objects":  # what was found is told
                messages.info(phrase("{name} is done", name=run.name))
            self.open_scene()
        elif state is not None and state.status == "stopped":
            messages.info(phrase("{name} was stopped; it can go on at any time", name=run.name))
        elif state is not None and state.problem:
            messages.error(f"{run.name}: {state.problem}")
        else:
            messages.error(f"{run.name}: {_read_complaint(run)}")
        if state is None:
            self.forget()

    def _keep_look(self, look: SourceLook) -> None:
        if self.look is not None and self.look.source == look.source:
            self.look = look


def read_figures(run: Path) -> dict[str, Any]:
    """Read the figures of a run's evaluation; empty where there are none."""
    try:
        figures = json.loads((run / FIGURES).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return figures if isinstance(figures, dict) else {}


def find_out_problem(run: Path, source: Path) -> str:
    """Say why a job cannot be begun in a folder; empty where it can."""
    state = _read_state(run)
    if state is not None:
        return "" if state.request.source == str(source.resolve()) else "This folder holds another job; choose another"
    return find_job_folder_problem(run)


def find_result(run: Path) -> Path:
    """Find what a job's folder is opened by: the project with the edits of a scene that was trained on, or itself."""
    project = locate_project(run)
    return project if project.is_file() else run


def find_job_folder_problem(run: Path) -> str:
    """Say why a folder cannot be that of a new job; empty where it can."""
    if os.path.isfile(run):
        return "There is a file of this name; choose a folder"
    if os.path.isdir(run) and os.listdir(run):
        return "This folder is not empty; choose another"
    return ""


def _read_state(run: Path) -> JobState | None:
    try:
        return read_job_state(run) if has_job(run) else None
    except DataError:
        return None


def _read_complaint(run: Path) -> str:
    try:
        return clean_complaint(locate_job_file(run, LOG).read_text(encoding="utf-8", errors="replace"))
    except OSError:
        return "the job ended without a word"
