"""How much memory this process may still take."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil

VARIABLE = "INSTDRIVE_MEMORY_GB"
"""Environment variable that takes the place of what the system says."""
_CGROUP = Path("/sys/fs/cgroup")
_assumed: list[float] = []


def measure_available_memory() -> float:
    """Measure the bytes that this process may still take.

    They are the least of what is free, what the process's own limit leaves, and what its container's limit leaves. The
    variable `INSTDRIVE_MEMORY_GB` and `assume_memory` come first.
    """
    if _assumed:
        return _assumed[-1]
    given = _parse_number(os.environ.get(VARIABLE, ""))
    if given is not None:
        return 1e9 * given
    return min(float(psutil.virtual_memory().available), _measure_left_by_limit(), _measure_left_by_container())


@contextmanager
def assume_memory(size: float) -> Iterator[None]:
    """Take `size` bytes to be available inside the block, in all threads."""
    _assumed.append(size)
    try:
        yield
    finally:
        _assumed.remove(size)


def _measure_left_by_limit() -> float:
    if sys.platform == "win32":
        return math.inf
    import resource

    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit == resource.RLIM_INFINITY:
        return math.inf
    return max(float(limit - psutil.Process().memory_info().vms), 0.0)


def _measure_left_by_container() -> float:
    limit, used = (_read_number(_CGROUP / name) for name in ("memory.max", "memory.current"))
    return math.inf if limit is None or used is None else max(limit - used, 0.0)


def _read_number(path: Path) -> float | None:
    try:
        return _parse_number(path.read_text())
    except OSError:
        return None


def _parse_number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if value >= 0 else None
