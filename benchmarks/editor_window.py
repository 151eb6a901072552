"""The editor as a process: how soon its window is there, and what it costs while nobody does anything."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import psutil

from instdrive_app.shell.display import has_display
from instdrive_app.shell.virtual_display import open_virtual_display

PATIENCE = 60.0


def help_seconds(runs: int = 5) -> float:
    """Median time of `instdrive --help`."""
    taken = []
    for _ in range(runs):
        started = time.perf_counter()
        subprocess.run([sys.executable, "-m", "instdrive_app.main", "--help"], check=True, stdout=subprocess.DEVNULL)
        taken.append(time.perf_counter() - started)
    return statistics.median(taken)


def window_figures(scene: Path, folder: Path, idle_seconds: float = 8.0) -> tuple[float, float]:
    """Seconds until the window has drawn its first frame, and percent of one core used while it idles on a scene.

    Raises DisplayError where no window can be opened.
    """
    with nullcontext() if has_display() else open_virtual_display(), _running(scene, folder) as (process, report):
        window = _wait(lambda: bool(_last(report)), process)
        _wait(lambda: bool(_last(report).get("open") and _last(report).get("settled")), process)
        time.sleep(2.0)
        before, started = _cpu_seconds(process.pid), time.perf_counter()
        time.sleep(idle_seconds)
        used = _cpu_seconds(process.pid) - before
        return window, 100 * used / (time.perf_counter() - started)


@contextmanager
def _running(scene: Path, folder: Path) -> Iterator[tuple[subprocess.Popen[bytes], Path]]:
    report = folder / "window.jsonl"
    command = [sys.executable, "-m", "instdrive_app.main", "edit", str(scene), "--report", str(report)]
    environment = {**os.environ, "INSTDRIVE_STATE": str(folder / "state")}
    process = subprocess.Popen([*command, "--no-remember-layout"], env=environment)
    try:
        yield process, report
    finally:
        process.terminate()
        process.wait(PATIENCE)


def _wait(reached: Callable[[], bool], process: subprocess.Popen[bytes]) -> float:
    started = time.perf_counter()
    while not reached():
        if process.poll() is not None:
            raise RuntimeError(f"the editor ended with status {process.returncode}")
        if time.perf_counter() - started > PATIENCE:
            raise TimeoutError(f"the window did not come so far in {PATIENCE:.0f} s")
        time.sleep(0.01)
    return time.perf_counter() - started


def _last(report: Path) -> dict[str, Any]:
    """The last whole line that the window reported, empty before the first."""
    lines = report.read_text(encoding="utf-8").rsplit("\n", 2) if report.exists() else []
    return json.loads(lines[-2]) if len(lines) > 1 else {}


def _cpu_seconds(pid: int) -> float:
    times = psutil.Process(pid).cpu_times()
    return times.user + times.system
