"""Progress of long work, and stopping it, without a callback handed through every function.

Work that may take a second calls `report` now and then. Whoever wants to know wraps the work in `report_to`; where
nobody does, `report` costs next to nothing. The listener belongs to the thread (or context) that set it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from instdrive_core.errors import InstDriveError

Listener = Callable[[float], None]
"""Gets the share done, 0 … 1; raises `CancelledError` to stop the work."""


class CancelledError(InstDriveError):
    """The user has stopped the work; what was there before it is still there."""


_listener: ContextVar[Listener | None] = ContextVar("progress listener", default=None)
_span: ContextVar[tuple[float, float]] = ContextVar("progress span", default=(0.0, 1.0))


def report(share: float) -> None:
    """Report that `share` (0 … 1) of the present part of the work is done. Raises CancelledError to stop the work."""
    listener = _listener.get()
    if listener is not None:
        start, stop = _span.get()
        listener(start + (stop - start) * min(max(share, 0.0), 1.0))


@contextmanager
def report_to(listener: Listener) -> Iterator[None]:
    """Pass what is reported inside the block to `listener`."""
    outer, span = _listener.set(listener), _span.set((0.0, 1.0))
    try:
        yield
    finally:
        _listener.reset(outer)
        _span.reset(span)


@contextmanager
def report_span(start: float, stop: float) -> Iterator[None]:
    """Count what is reported inside the block, 0 … 1, as `start` … `stop` of the work around it."""
    low, high = _span.get()
    token = _span.set((low + (high - low) * start, low + (high - low) * stop))
    try:
        report(0.0)
        yield
    finally:
        _span.reset(token)
