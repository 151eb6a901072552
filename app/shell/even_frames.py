"""Keeps what Python does beside drawing from making single frames long."""

from __future__ import annotations

import gc
import sys

_TURN = 0.001
"""Seconds for which a thread that computes in Python keeps the others waiting; Python's own choice is five times that.
Each call that waits for something else costs the UI's thread such a turn, and a frame has dozens of them."""


def share_fairly() -> None:
    """Let the UI's thread go on sooner beside work of other threads."""
    sys.setswitchinterval(_TURN)


def settle_memory() -> None:
    """Take everything that has been loaded out of the search for garbage, which else stops all threads for a tenth of
    a second now and then. Call it once what the program needs is imported."""
    gc.freeze()  # without a search before, which would be such a stop
