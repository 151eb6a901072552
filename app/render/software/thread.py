"""A thread that draws the latest frame asked for, without making the caller wait."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

Asked = TypeVar("Asked")
Drawn = TypeVar("Drawn")


class Superseded(Exception):
    """Raised when a frame is abandoned for a newer one."""


class LatestFrame(Generic[Asked, Drawn]):
    """Draws what was asked for last on another thread.

    Everything that crosses between the threads is passed under one lock and belongs to the receiver from then on.
    """

    def __init__(
        self, draw: Callable[[Asked, Callable[[], Asked | None]], Drawn], wake: Callable[[], None] = lambda: None
    ) -> None:
        """Start the thread.

        Args:
            draw: Draws a frame. Its second argument returns, at any time, the frame that is waiting, or None; `draw`
                raises `Superseded` if that makes the present frame useless.
            wake: Called from the thread when a frame is ready.
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
        """Ask for a frame, which replaces one that is still waiting."""
        with self._changed:
            self._waiting = frame
            self._changed.notify_all()

    @property
    def busy(self) -> bool:
        """Whether a frame is waiting or being drawn."""
        return self._waiting is not None or self._drawing is not None

    def take(self, patience: float = 0.0) -> Drawn | None:
        """Take the newest frame drawn since the last call, if any. Raises what drawing raised.

        Args:
            patience: Seconds to wait for a frame.
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
        """Wait until everything asked for is drawn, then take the newest frame. Raises what drawing raised."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting is None and self._drawing is None)
        return self.take()

    def close(self) -> None:
        """End the thread after it has finished the frame that it is drawing."""
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
            except BaseException as error:  # raised again on the caller's thread
                drawn, failure = None, error
            with self._changed:
                self._drawn, self._failure = drawn, failure
                self._changed.notify_all()
            self._wake()
