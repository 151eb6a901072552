"""Rows of a per-splat array that must be uploaded again."""

from __future__ import annotations

_REMEMBERED = 64
"""Ranges kept apart; older ones are merged."""


class DirtyRows:
    """A log of touched ranges that any number of readers follow, each at its own pace.

    A reader that falls far behind is told a wider range, never a narrower one, so the log stays short without knowing
    its readers. All `count` rows are dirty to begin with.
    """

    def __init__(self, count: int) -> None:
        self._log = [(1, 0, count)]
        self._serial = 1

    def touch(self, start: int, stop: int) -> None:
        """Mark rows `start` … `stop` - 1 as dirty for every reader."""
        self._serial += 1
        self._log.append((self._serial, start, stop))
        if len(self._log) > _REMEMBERED:
            oldest, second = self._log[:2]
            self._log[:2] = [(second[0], min(oldest[1], second[1]), max(oldest[2], second[2]))]

    def shorten(self, count: int) -> None:
        """Forget rows from `count` on."""
        clipped = ((serial, start, min(stop, count)) for serial, start, stop in self._log)
        self._log = [entry for entry in clipped if entry[1] < entry[2]]

    def create_reader(self) -> DirtyReader:
        """Create a reader, to which all rows are dirty at first."""
        return DirtyReader(self)

    def collect_since(self, serial: int) -> tuple[tuple[int, int] | None, int]:
        """Collect the range of all rows touched after `serial` (0 = from the beginning), and the present serial."""
        newer = [(start, stop) for number, start, stop in self._log if number > serial and start < stop]
        if not newer:
            return None, self._serial
        return (min(start for start, _ in newer), max(stop for _, stop in newer)), self._serial


class DirtyReader:
    """One follower of a `DirtyRows`."""

    def __init__(self, rows: DirtyRows) -> None:
        self._rows, self._serial = rows, 0

    def take(self) -> tuple[int, int] | None:
        """Take the range ``(start, stop)`` that holds all rows touched since this reader's last call, or None."""
        taken, self._serial = self._rows.collect_since(self._serial)
        return taken
