"""Photos and masks that stay on a GPU once they were sent there, so that a step need not send them again."""

from __future__ import annotations

import threading
import weakref
from collections import OrderedDict
from collections.abc import Callable

from numpy import ndarray
from torch import Tensor


class SentArrays:
    """Keeps the device's copy of an array for as long as the array itself lives, within a budget of bytes.

    Copies least recently asked for leave first. Arrays must not be written to once they were sent.
    """

    def __init__(self, choose_budget: Callable[[], int]) -> None:
        """`choose_budget` is asked for the bytes when the first array is sent."""
        self._choose_budget = choose_budget
        self._budget: int | None = None
        self._kept: OrderedDict[int, tuple[weakref.ref[ndarray], Tensor]] = OrderedDict()
        self._bytes = 0
        self._lock = threading.RLock()  # an array may die, and tell so, while this thread holds it
        self.sent_count = 0
        """How many arrays were sent so far."""

    @property
    def kept_bytes(self) -> int:
        """Bytes of copies on the device."""
        return self._bytes

    def find_or_send(self, array: ndarray, send: Callable[[ndarray], Tensor]) -> Tensor:
        """Find the copy of an array on the device, or make one by `send`."""
        with self._lock:
            entry = self._kept.get(id(array))
            if entry is not None and entry[0]() is array:
                self._kept.move_to_end(id(array))
                return entry[1]
        copy = send(array)
        self.sent_count += 1
        self._keep(array, copy)
        return copy

    def _keep(self, array: ndarray, copy: Tensor) -> None:
        with self._lock:
            if self._budget is None:
                self._budget = self._choose_budget()
            self._drop(id(array))
            if copy.nbytes > self._budget:
                return
            while self._bytes + copy.nbytes > self._budget:
                self._drop(next(iter(self._kept)))
            number = id(array)

            def forget(dead: weakref.ref[ndarray]) -> None:
                with self._lock:
                    entry = self._kept.get(number)
                    if entry is not None and entry[0] is dead:  # its number may be another array's by now
                        self._drop(number)

            self._kept[number] = weakref.ref(array, forget), copy
            self._bytes += copy.nbytes

    def _drop(self, number: int) -> None:
        entry = self._kept.pop(number, None)
        if entry is not None:
            self._bytes -= entry[1].nbytes
