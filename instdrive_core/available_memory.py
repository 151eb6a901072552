"""How much memory this process may still take."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

VARIABLE = "INSTDRIVE_MEMORY_GB"
"""Environment variable that takes the place of what the system says."""
UNKNOWN = 64e9
"""Bytes believed to be there where the system does not say."""
_CGROUP = Path("/sys/fs/cgroup")
_assumed: list[float] = []


def measure_available_memory() -> float:
    """Bytes: the least of what is free, what the process's own limit leaves, and what its container's limit leaves.

    The variable `INSTDRIVE_MEMORY_GB` and `assume_memory` come first.
    """
    if _assumed:
        return _assumed[-1]
    said = _number(os.environ.get(VARIABLE, ""))
    if said is not None:
        return 1e9 * said
    return min(_free(), _left_by_limit(), _left_by_container())


@contextmanager
def assume_memory(size: float) -> Iterator[None]:
    """Within it, `size` bytes are taken to be there, in all threads."""
    _assumed.append(size)
    try:
        yield
    finally:
        _assumed.remove(size)


def _free() -> float:
    fields = _fields(Path("/proc/meminfo"))
    if "MemAvailable" in fields:
        return fields["MemAvailable"]
    try:
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, ValueError, OSError):  # Windows, or a system that does not know
        return UNKNOWN


def _left_by_limit() -> float:
    if sys.platform == "win32":
        return math.inf
    import resource

    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit == resource.RLIM_INFINITY:
        return math.inf
    return max(limit - _fields(Path("/proc/self/status")).get("VmSize", 0.0), 0.0)


def _left_by_container() -> float:
    limit, used = (_read_number(_CGROUP / name) for name in ("memory.max", "memory.current"))
    return math.inf if limit is None or used is None else max(limit - used, 0.0)


def _fields(path: Path) -> dict[str, float]:
    """Fields in kB of a file below /proc, as bytes; none where there is no such file."""
    try:
        lines = path.read_text().splitlines()
    except OSError:
        return {}
    words = (line.replace(":", " ").split() for line in lines)
    return {parts[0]: 1024 * float(parts[1]) for parts in words if len(parts) == 3 and parts[2] == "kB"}


def _read_number(path: Path) -> float | None:
    try:
        return _number(path.read_text())
    except OSError:
        return None


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if value >= 0 else None
