"""How long frames take, without waiting for the GPU at the end of each."""

from __future__ import annotations

import time
from dataclasses import dataclass
from types import TracebackType
from weakref import WeakKeyDictionary

import moderngl


@dataclass
class _Timer:
    """A context's only query: moderngl never frees queries."""

    query: moderngl.Query
    user: FrameClock | None = None
    """Who has timed with it last."""


_TIMERS: WeakKeyDictionary[moderngl.Context, _Timer] = WeakKeyDictionary()


class FrameClock:
    """Times what is drawn inside its `with`: the larger of what the CPU and what the GPU spent on it.

    The GPU's time is read before the next frame, when it is known, so that nobody waits for it.
    """

    def __init__(self, ctx: moderngl.Context) -> None:
        if ctx not in _TIMERS:
            _TIMERS[ctx] = _Timer(ctx.query(time=True))
        self._timer = _TIMERS[ctx]
        self._started = self._on_cpu = 0.0
        self._is_pending = False
        self.seconds = 0.0
        """Seconds of the last frame that counted."""
        self.counts = False
        """Whether the frame that is being drawn counts; set it inside the `with`."""

    def read(self) -> None:
        """Read the time of the last frame, if it counted."""
        if self._is_pending:
            on_gpu = self._timer.query.elapsed * 1e-9 if self._timer.user is self else 0.0
            self.seconds, self._is_pending = max(self._on_cpu, on_gpu), False

    def __enter__(self) -> FrameClock:
        self.counts, self._started = False, time.perf_counter()
        self._timer.user = self
        self._timer.query.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._timer.query.__exit__()
        self._on_cpu, self._is_pending = time.perf_counter() - self._started, self.counts
        if self._is_pending and not self.seconds:
            self.seconds = self._on_cpu

    def release(self) -> None:
        """Let go of the context's timer."""
        if self._timer.user is self:
            self._timer.user = None
