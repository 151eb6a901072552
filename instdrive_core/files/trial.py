"""Reading a file in a process of its own first, for libraries that damaged files can end the whole program through."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

_PATIENCE, _BYTES_PER_SECOND = 15.0, 20e6
_REFUSED, _OUT_OF_MEMORY = 3, 4


def survives_trial(module: str, path: Path, spare: int) -> bool:
    """Whether a process that runs `module` on a file ends by itself, in time, and within `spare` bytes of memory.

    Errors that Python sees do not count: the reader itself says what they are.
    """
    seconds = _PATIENCE + path.stat().st_size / _BYTES_PER_SECOND
    command = [sys.executable, "-P", "-m", module, str(path), str(spare)]
    silent = subprocess.DEVNULL
    try:
        ended = subprocess.run(command, timeout=seconds, check=False, stdin=silent, stdout=silent, stderr=silent)
    except subprocess.TimeoutExpired:
        return False
    return ended.returncode in (0, _REFUSED)


def run_trial(read: Callable[[str], None]) -> None:
    """Read the file that the command line names, within the memory that it allows beyond what is used now (Linux)."""
    path, spare = sys.argv[1:3]
    try:
        import resource

        lines = Path("/proc/self/status").read_text().splitlines()
        used = next(1024 * int(line.split()[1]) for line in lines if line.startswith("VmData"))
        resource.setrlimit(resource.RLIMIT_DATA, (used + int(spare), used + int(spare)))
    except (ImportError, OSError):  # other systems
        pass
    try:
        read(path)
    except MemoryError:
        sys.exit(_OUT_OF_MEMORY)
    except Exception:
        sys.exit(_REFUSED)
