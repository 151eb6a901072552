"""Work beside the UI: one background thread, results and errors delivered on the UI's thread."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

from instdrive_core.errors import InstDriveError


@dataclass
class Job:
    """One piece of work, waiting, running or done."""

    title: str
    """Present participle for the progress box, e.g. ``Opening street.ply``."""
    future: Future
    done: Callable[[Any], None]
    modal: bool
    """Whether edits wait until it is done."""


class Jobs:
    """Runs jobs one after the other. `poll` must be called on the UI's thread, every frame."""

    def __init__(self, report_error: Callable[[str], None], wake: Callable[[], None] = lambda: None) -> None:
        """`report_error` gets a text for the user; `wake` is called from the worker when something is done."""
        self._report_error, self._wake = report_error, wake
        self._pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="editor-job")
        self._jobs: list[Job] = []

    @property
    def current(self) -> Job | None:
        """The job that runs or waits longest."""
        return self._jobs[0] if self._jobs else None

    @property
    def blocking(self) -> bool:
        """Whether a modal job is under way."""
        return any(job.modal for job in self._jobs)

    def submit(
        self, title: str, work: Callable[[], Any], done: Callable[[Any], None] = lambda _: None, modal: bool = True
    ) -> None:
        """Run `work` in the background, then `done(result)` on the UI's thread."""
        future = self._pool.submit(work)
        future.add_done_callback(lambda _: self._wake())
        self._jobs.append(Job(title, future, done, modal))

    def poll(self) -> None:
        """Deliver what has finished. A failure becomes a message; one that is our bug comes with its traceback."""
        while self._jobs and self._jobs[0].future.done():
            job = self._jobs.pop(0)
            error = job.future.exception()
            if error is None:
                job.done(job.future.result())
            elif isinstance(error, InstDriveError):
                self._report_error(str(error))
            else:
                trace = "".join(traceback.format_exception(error))
                self._report_error(f"{job.title} failed: {error!r}. Please report this:\n{trace}")

    def close(self) -> None:
        """Wait for the running job; drop those that have not begun."""
        self._pool.shutdown(wait=True, cancel_futures=True)
