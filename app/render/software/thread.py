"""A thread that draws: of the frames asked for only the latest is drawn, and nobody waits who does not want to."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

Asked = TypeVar("Asked")
Drawn = TypeVar("Drawn")


class Superseded(Exception):
    """The frame was given up for a newer one."""


class LatestFrame(Generic[Asked, Drawn]):
    """Draws on a thread of its own what was asked for last.

    Everything that crosses between the threads is handed over under one lock and belongs to the receiver from then on.
    """

    def __init__(
        self, draw: Callable[[Asked, Callable[[], Asked | None]], Drawn], wake: Callable[[], None] = lambda: None
    ) -> None:
        """Start the thread.

        Args:
            draw: makes a frame of what was asked for. Its second argument tells, at any time, what waits already, or
                None: where that makes the present frame useless, raise `Superseded`.
            wake: called from the thread when a frame is there.
        """
        self._draw, self._wake = draw, wake
        self._changed = threading.Condition()
        self._waiting: Asked | None = None
        self._drawing: Asked | None = None
        self._drawn: Drawn | None = None
        self._failure: BaseException | None = None
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="software-renderer", daemon=True)
        self._thread.start()

    def ask(self, frame: Asked) -> None:
        """Draw this next; what waited until now is forgotten."""
        with self._changed:
            self._waiting = frame
            self._changed.notify_all()

    @property
    def busy(self) -> bool:
        """Whether a frame is under way."""
        return self._waiting is not None or self._drawing is not None

    def take(self, patience: float = 0.0) -> Drawn | None:
        """The newest frame drawn since the last call. Raises what drawing raised.

        Args:
            patience: seconds that the caller would spend on nothing better while a frame is under way.
        """
        with self._changed:
            if patience > 0:
                self._changed.wait_for(lambda: self._drawn is not None or self._failure is not None, patience)
            failure, self._failure = self._failure, None
            if failure is not None:
                raise failure
            drawn, self._drawn = self._drawn, None
            return drawn

    def wait(self) -> Drawn | None:
        """As `take`, when all that was asked for is drawn."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting is None and self._drawing is None)
        return self.take()

    def close(self) -> None:
        """End the thread; a frame being drawn is finished first."""
        with self._changed:
            self._waiting, self._closed = None, True
            self._changed.notify_all()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._drawing = None
                self._changed.notify_all()
                self._changed.wait_for(lambda: self._waiting is not None or self._closed)
                if self._closed or self._waiting is None:
                    return
                frame, self._drawing, self._waiting = self._waiting, self._waiting, None
            try:
                drawn, failure = self._draw(frame, lambda: self._waiting), None
            except Superseded:
                continue
            except BaseException as error:  # it is the asker's to know, on the asker's thread
                drawn, failure = None, error
            with self._changed:
                self._drawn, self._failure = drawn, failure
                self._changed.notify_all()
            self._wake()
