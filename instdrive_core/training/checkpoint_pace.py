"""How often a run is saved: by time, so that checkpoints of gigabytes do not take most of a run."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

SHARE = 0.05
"""Largest share of a run's time that goes into checkpoints."""
_QUICK = 0.2
"""Seconds; checkpoints that take less are always written."""


@dataclass
class CheckpointPace:
    """Says at each point worth keeping whether enough time has passed since the last checkpoint.

    What is trained does not depend on it: it changes only from where a killed run goes on.
    """

    clock: Callable[[], float] = time.monotonic
    """Seconds."""
    _ended: float = 0.0
    _took: float = 0.0

    def is_due(self) -> bool:
        """Whether another checkpoint that takes as long as the last would keep within `SHARE`; true for the first."""
        return self._took < _QUICK or self.clock() - self._ended >= self._took * (1 / SHARE - 1)

    @contextmanager
    def time_saving(self) -> Iterator[None]:
        """Time the checkpoint that is saved within."""
        began = self.clock()
        yield
        self._ended = self.clock()
        self._took = self._ended - began
