"""Keeps what happens beside drawing from making single frames long."""

from __future__ import annotations

import gc
import os
import sys
from contextlib import suppress
from threading import get_native_id

_TURN = 0.001
"""Seconds for which a thread that computes in Python keeps the others waiting; Python's own choice is five times that.
Each call that waits for something else costs the UI's thread such a turn, and a frame has dozens of them."""
_NICENESS = 10
"""For threads that nobody waits for: they get a tenth of a core that the window wants, too, and all of others. What
they start inherits it, and may not take it back: a training is not started there."""


def share_fairly() -> None:
    """Let the UI's thread go on sooner beside work of other threads."""
    sys.setswitchinterval(_TURN)


def settle_memory() -> None:
    """Take everything that has been loaded out of the search for garbage, which else stops all threads for a tenth of
    a second now and then. Call it once what the program needs is imported."""
    gc.freeze()  # without a search before, which would be such a stop


def stand_back() -> None:
    """Leave the cores to others: the calling thread, and those that it starts, take what is left. Linux only: elsewhere
    a thread has no priority of its own that is set so, and nothing happens."""
    if sys.platform.startswith("linux"):
        with suppress(OSError):  # a sandbox may forbid it: the work is done all the same
            os.setpriority(os.PRIO_PROCESS, get_native_id(), _NICENESS)
