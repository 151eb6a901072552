"""Background work such as opening and exporting, whose failures come back as messages."""

from __future__ import annotations

import logging
from collections.abc import Callable
from concurrent.futures import CancelledError as NeverBegunError
from concurrent.futures import Future, ThreadPoolExecutor
from contextvars import copy_context
from dataclasses import dataclass, field
from threading import Event
from typing import Any

from instdrive_app.even_frames import stand_back
from instdrive_app.memory import release_freed_memory
from instdrive_app.messages import read_error, user_message
from instdrive_core.errors import EditError, InstDriveError
from instdrive_core.progress import CancelledError, report_to
from instdrive_core.wording import phrase

_log = logging.getLogger(__name__)


@dataclass
class Job:
    """A piece of work: waiting, running or done."""

    title: str
    """Text of the progress box, e.g. ``Opening street.ply``."""
    on_done: Callable[[Any], None]
    modal: bool
    """Whether edits are refused until it is done."""
    on_failure: Callable[[BaseException], bool]
    """Gets the exception; returns whether it was handled, so that the user is not told."""
    future: Future[Any] = field(default_factory=Future)
    share: float | None = None
    """Share that is done, in [0, 1]; None while that is unknown."""
    stop: Event = field(default_factory=Event)
    over: bool = False
    """Whether its end has been delivered, whatever it was."""

    def report_share(self, share: float) -> None:
        """Note the share that is done, on the work's thread. Raises CancelledError where the job was cancelled."""
        self.share = share
        if self.stop.is_set():
            raise CancelledError(phrase("{title} was cancelled", title=phrase(self.title)))


class Jobs:
    """Runs jobs one after another. Call `poll` on the UI's thread in every frame."""

    def __init__(
        self,
        report_error: Callable[[str], None],
        wake: Callable[[], None] = lambda: None,
        report_cancelled: Callable[[str], None] = lambda _: None,
    ) -> None:
        """The reports get a text for the user; `wake` is called on the worker's thread when a job ends."""
        self._report_error, self._report_cancelled, self._wake = report_error, report_cancelled, wake
        self._pool = ThreadPoolExecutor(1, "editor-job")
        self._background_pool = ThreadPoolExecutor(1, "editor-background", initializer=stand_back)
        self._jobs: list[Job] = []
        self._background_jobs: list[Job] = []

    @property
    def current(self) -> Job | None:
        """The job that has run or waited longest; background jobs come last."""
        return next(iter((*self._jobs, *self._background_jobs)), None)

    @property
    def is_blocking(self) -> bool:
        """Whether a modal job waits or runs."""
        return any(job.modal for job in self._jobs)

    def submit(
        self,
        title: str,
        work: Callable[[], Any],
        on_done: Callable[[Any], None] = lambda _: None,
        modal: bool = True,
        on_failure: Callable[[BaseException], bool] = lambda _: False,
    ) -> Job:
        """Run `work` on another thread, then `on_done(result)` on the UI's thread.

        What `work` reports through `instdrive_core.progress.report` is the job's `share`. A failure goes to
        `on_failure`, and to the user where that returns False.
        """
        job = Job(title, on_done, modal, on_failure)
        self._start(self._pool, job, work)
        self._jobs.append(job)
        return job

    def submit_in_background(
        self,
        title: str,
        work: Callable[[], Any],
        on_done: Callable[[Any], None] = lambda _: None,
        on_failure: Callable[[BaseException], bool] = lambda _: False,
    ) -> None:
        """Run work that nobody waits for, beside the other jobs and never modal.

        Earlier jobs of the same title are cancelled, since only the newest result is wanted.
        """
        for old in [job for job in self._background_jobs if job.title == title]:
            old.stop.set()
            old.future.cancel()
            self._background_jobs.remove(old)
        job = Job(title, on_done, False, on_failure)
        self._start(self._background_pool, job, work)
        self._background_jobs.append(job)

    def _start(self, pool: ThreadPoolExecutor, job: Job, work: Callable[[], Any]) -> None:
        def run() -> Any:
            try:
                with report_to(job.report_share):
                    return work()
            finally:
                release_freed_memory()

        job.future = pool.submit(copy_context().run, run)
        job.future.add_done_callback(lambda _: self._wake())

    def cancel(self) -> None:
        """Stop the current job when it next reports its progress."""
        job = self.current
        if job is not None:
            job.stop.set()
            job.future.cancel()

    def poll(self) -> None:
        """Deliver finished jobs. A failure becomes a message; a bug of ours is logged with its traceback."""
        for jobs in (self._jobs, self._background_jobs):
            while jobs and jobs[0].future.done():
                self._deliver(jobs.pop(0))

    def _deliver(self, job: Job) -> None:
        job.over = True
        error = None if job.future.cancelled() else job.future.exception()
        if job.future.cancelled() or isinstance(error, CancelledError | NeverBegunError):
            self._report_cancelled(phrase("{title} was cancelled", title=phrase(job.title)))
        elif error is None:
            job.on_done(job.future.result())
        elif job.on_failure(error):
            _log.info("%s failed: %s", job.title, error)
        elif isinstance(error, InstDriveError):
            self._report_error(user_message(error) if isinstance(error, EditError) else read_error(error))
        else:
            _log.error("%s failed", job.title, exc_info=error)
            self._report_error(
                phrase(
                    "{title} failed: {error!r}. Help › Log file has the details. Please report it",
                    title=phrase(job.title),
                    error=error,
                )
            )

    def close(self) -> None:
        """Wait for the running job, so that an export is complete; drop waiting jobs and stop background jobs."""
        for job in self._background_jobs:
            job.stop.set()
        self._background_pool.shutdown(wait=True, cancel_futures=True)
        self._pool.shutdown(wait=True, cancel_futures=True)
