"""Ends what a killed driver leaves behind: Ray's workers die with it, two of Ray's agents would stay for ever.

`start_reaper` starts this module as a process, which waits until its driver is gone.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys

import psutil

_PATIENCE = 5.0
"""Seconds for processes to end by themselves."""


def start_reaper() -> subprocess.Popen[str]:
    """Start a process that ends all descendants of this one once this one is gone, or closes the pipe to it."""
    listed = (f"{child.pid} {child.create_time()}" for child in psutil.Process().children(recursive=True))
    text = "".join(f"{line}\n" for line in listed)
    reaper = subprocess.Popen(
        [sys.executable, "-m", "instdrive_core.fleet.reaper"],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
    )
    assert reaper.stdin is not None
    reaper.stdin.write(text)
    reaper.stdin.flush()
    return reaper


def end_processes(lines: list[str]) -> None:
    """End processes that are listed as number and time of birth, the numbers of which are given out again."""
    alive = []
    for line in lines:
        number, birth = line.split()
        with contextlib.suppress(psutil.NoSuchProcess):
            process = psutil.Process(int(number))
            if process.create_time() == float(birth) and process.pid != os.getpid():
                alive.append(process)
    _, alive = psutil.wait_procs(alive, timeout=_PATIENCE)
    for process in alive:
        with contextlib.suppress(psutil.NoSuchProcess):
            process.terminate()
    _, alive = psutil.wait_procs(alive, timeout=_PATIENCE)
    for process in alive:
        with contextlib.suppress(psutil.NoSuchProcess):
            process.kill()


if __name__ == "__main__":
    end_processes(sys.stdin.read().splitlines())  # ends when the driver closes the pipe, or dies
