"""Which rows of a per-splat array must be uploaded again."""

from __future__ import annotations


class DirtyRows:
    """One growing range of rows; starts with all `count` of them."""

    def __init__(self, count: int) -> None:
        self._range: tuple[int, int] | None = (0, count)

    def touch(self, start: int, stop: int) -> None:
        """Widen the range to hold rows `start` … `stop` - 1."""
        known = self._range
        self._range = (start, stop) if known is None else (min(start, known[0]), max(stop, known[1]))

    def take(self) -> tuple[int, int] | None:
        """The range since the last call, or None."""
        taken, self._range = self._range, None
        return taken

    def shorten(self, count: int) -> None:
        """Forget rows from `count` on."""
        if self._range is not None:
            start, stop = min(self._range[0], count), min(self._range[1], count)
            self._range = (start, stop) if start < stop else None
