"""One driver for a folder of runs: a second one is refused while the first works."""

from __future__ import annotations

import json
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager

from instdrive_core.errors import OptionError
from instdrive_core.files.file_lock import FileLock
from instdrive_core.fleet.place import FleetPlace

LOCK = "fleet.lock"
LEASE_SECONDS = 120.0
"""Time after which an address whose driver was killed is free again."""
RENEW_SECONDS = LEASE_SECONDS / 4
"""Time between two renewals."""


class FleetHold:
    """A place held by this process."""

    def __init__(self, place: FleetPlace) -> None:
        self._place, self._token, self._lock = place, uuid.uuid4().hex, None
        self._renewed = float("-inf")
        if place.folder is not None:
            self._lock = FileLock.acquire(place.folder / LOCK)
            if self._lock is None:
                raise OptionError(f"{place.root}: another `instdrive fleet` works here. Wait for it, or stop it first.")
            return
        left = self._read_seconds_left()
        if left > 0:
            problem = f"another `instdrive fleet` works here, or was killed. It is free in {left:.0f} s"
            raise OptionError(f"{place.root}: {problem} unless that one goes on.")
        self.renew()

    def renew(self) -> None:
        """Say that this process still works; at an address every `RENEW_SECONDS`.

        Raises OptionError where another driver took the place meanwhile.
        """
        if self._lock is not None or time.monotonic() - self._renewed < RENEW_SECONDS:
            return
        if self._read_seconds_left() > 0:
            raise OptionError(f"{self._place.root}: another `instdrive fleet` has taken over.")
        self._write(time.time())
        self._renewed = time.monotonic()

    def release(self) -> None:
        """Let others work here."""
        if self._lock is not None:
            self._lock.release()
        elif self._read_seconds_left() <= 0:  # else another one has taken over
            self._write(0.0)

    def _write(self, moment: float) -> None:
        self._place.write(LOCK, json.dumps({"holder": self._token, "at": moment}).encode())

    def _read_seconds_left(self) -> float:
        """Seconds for which another one holds the place."""
        try:
            held = json.loads(self._place.read(LOCK) or b"{}")
            is_own, at = held.get("holder") == self._token, float(held.get("at", 0.0))
        except (ValueError, TypeError, AttributeError):
            return 0.0
        return 0.0 if is_own else min(at + LEASE_SECONDS - time.time(), LEASE_SECONDS)


@contextmanager
def hold_place(place: FleetPlace) -> Iterator[FleetHold]:
    """Hold a place inside the block. Raises OptionError where another driver does."""
    hold = FleetHold(place)
    try:
        yield hold
    finally:
        hold.release()
