"""Runs cells in processes of their own: a few at a time, none twice, and none that the time left does not hold."""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from benchmarks.cells import Cell

ROOT = Path(__file__).resolve().parents[1]
THREADS = 2
"""Threads of each process."""
_POLL = 0.1


@dataclass
class Outcome:
    """What became of the cells."""

    done: list[str] = field(default_factory=list)
    """By this call."""
    failed: list[str] = field(default_factory=list)
    left: list[str] = field(default_factory=list)
    """Neither done, now or earlier, nor failed."""


@dataclass(frozen=True)
class Queue:
    """How cells become processes."""

    command: Callable[[Cell], list[str]]
    is_done: Callable[[Cell], bool]
    log_file: Callable[[Cell], Path]
    say: Callable[[str], None]
    jobs: int = 1
    budget: float | None = None
    """Seconds. No cell starts that is not expected to end within it; what still runs then is stopped, and goes on
    next time."""

    def run(self, cells: Sequence[Cell]) -> Outcome:
        """Do what is not done yet, in the order given; what needs a failed cell is left."""
        started = time.monotonic()
        outcome = Outcome()
        waiting = [cell for cell in cells if not self.is_done(cell)]
        running: list[_Running] = []
        try:
            while waiting or running:
                running = self._reaped(running, outcome)
                spent = time.monotonic() - started
                if self.budget is not None and spent > self.budget:
                    break
                self._start_ready(waiting, running, spent, outcome)
                if not running:
                    break
                time.sleep(_POLL)
        finally:
            for each in running:
                each.stop()
        outcome.left = [cell.name for cell in cells if cell.name not in outcome.failed and not self.is_done(cell)]
        return outcome

    def _start_ready(self, waiting: list[Cell], running: list[_Running], spent: float, outcome: Outcome) -> None:
        unfinished = {cell.name for cell in waiting} | {each.cell.name for each in running} | set(outcome.failed)
        for cell in list(waiting):
            if len(running) >= self.jobs:
                return
            if unfinished & set(cell.needs):
                continue
            if self.budget is not None and spent + cell.seconds > self.budget:
                continue
            waiting.remove(cell)
            self.say(f"{cell.name} … (about {cell.seconds:.0f} s)")
            running.append(_Running.start(cell, self.command(cell), self.log_file(cell)))

    def _reaped(self, running: list[_Running], outcome: Outcome) -> list[_Running]:
        for each in running:
            code = each.process.poll()
            if code is None:
                continue
            each.log.close()
            if code == 0 and self.is_done(each.cell):
                outcome.done.append(each.cell.name)
                self.say(f"{each.cell.name}: {time.monotonic() - each.since:.0f} s")
            else:
                outcome.failed.append(each.cell.name)
                self.say(f"{each.cell.name} FAILED (exit {code}); {self.log_file(each.cell)} ends with:")
                self.say(_tail(self.log_file(each.cell)))
        return [each for each in running if each.process.returncode is None]


@dataclass(frozen=True)
class _Running:
    cell: Cell
    process: subprocess.Popen[bytes]
    log: IO[bytes]
    since: float

    @staticmethod
    def start(cell: Cell, command: list[str], log_file: Path) -> _Running:
        log_file.parent.mkdir(parents=True, exist_ok=True)
        log = log_file.open("ab")
        threads = {"NUMBA_NUM_THREADS": str(THREADS), "OMP_NUM_THREADS": str(THREADS)}
        environment = {**os.environ, **threads}
        process = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT, env=environment, cwd=ROOT)
        return _Running(cell, process, log, time.monotonic())

    def stop(self) -> None:
        """End the process; its checkpoint stays."""
        if self.process.poll() is None:
            self.process.terminate()
            self.process.wait()
        self.log.close()


def _tail(file: Path, lines: int = 12) -> str:
    return "\n".join(file.read_text(encoding="utf-8", errors="replace").splitlines()[-lines:])
