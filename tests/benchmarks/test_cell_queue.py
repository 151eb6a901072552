"""Cells as processes: order, failures, budget, and going on after a cut."""

import subprocess
import sys
import time
from pathlib import Path

import pytest

from benchmarks.cell_queue import Queue
from benchmarks.cells import Cell

CHAIN = (
    Cell("clip", "clip", "c", seconds=1),
    Cell("left", "method", "c", needs=("clip",), seconds=1),
    Cell("right", "method", "c", needs=("clip",), seconds=1),
    Cell("figure", "figure", "c", needs=("left", "right"), seconds=1),
)


def queue(folder: Path, script: str = "pass", jobs: int = 1, budget: float | None = None) -> Queue:
    """Each cell's process appends its name to a log, runs `script`, then leaves a file."""
    body = (
        "import sys, time; from pathlib import Path; name, folder = sys.argv[1], Path(sys.argv[2]);"
        "open(folder / 'order', 'a').write(name + ' ');" + script + ";(folder / (name + '.done')).touch()"
    )
    return Queue(
        command=lambda cell: [sys.executable, "-c", body, cell.name, str(folder)],
        is_done=lambda cell: (folder / f"{cell.name}.done").is_file(),
        log_file=lambda cell: folder / "logs" / cell.name,
        say=lambda text: None,
        jobs=jobs,
        budget=budget,
    )


def order(folder: Path) -> list[str]:
    return (folder / "order").read_text().split()


@pytest.mark.parametrize("jobs", [1, 3])
def test_cells_run_once_and_after_what_they_need(tmp_path, jobs):
    outcome = queue(tmp_path, jobs=jobs).run(CHAIN)
    assert sorted(outcome.done) == sorted(cell.name for cell in CHAIN)
    assert outcome.left == outcome.failed == []
    done = order(tmp_path)
    assert done[0] == "clip"
    assert done[-1] == "figure"
    assert queue(tmp_path, jobs=jobs).run(CHAIN).done == []
    assert order(tmp_path) == done


def test_what_needs_a_failed_cell_is_left_and_the_rest_is_done(tmp_path):
    said = []
    failing = queue(tmp_path, "sys.exit('broken lamp') if name == 'left' else None")
    outcome = Queue(failing.command, failing.is_done, failing.log_file, said.append).run(CHAIN)
    assert outcome.failed == ["left"]
    assert outcome.left == ["figure"]
    assert outcome.done == ["clip", "right"]
    assert "broken lamp" in "\n".join(said)


def test_nothing_starts_that_the_budget_does_not_hold(tmp_path):
    outcome = queue(tmp_path, budget=0.5).run(CHAIN)
    assert outcome.done == []
    assert len(outcome.left) == len(CHAIN)


def test_a_cell_that_outlives_the_budget_is_stopped(tmp_path):
    outcome = queue(tmp_path, "time.sleep(10**6)", budget=1.5).run(CHAIN)  # else the tests' time limit ends it
    assert outcome.done == outcome.failed == []
    assert queue(tmp_path).run(CHAIN).done == [cell.name for cell in CHAIN]


def test_a_cell_ends_with_the_process_that_started_it(tmp_path):
    worker = (
        "import os, time; from pathlib import Path; from benchmarks.cell_work import end_with_parent;"
        f"end_with_parent(); Path({str(tmp_path / 'pid')!r}).write_text(str(os.getpid())); time.sleep(3600)"
    )
    root = Path(__file__).resolve().parents[2]
    parent = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {worker!r}], cwd={str(root)!r})"
    process = subprocess.Popen([sys.executable, "-c", parent])
    pid = tmp_path / "pid"
    assert _within(240, lambda: pid.is_file() and pid.read_text() != "")
    process.kill()
    process.wait()
    assert _within(240, lambda: not _runs(int(pid.read_text())))


def _runs(pid: int) -> bool:
    stat = Path(f"/proc/{pid}/stat")
    try:
        return stat.read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def _within(seconds: float, condition) -> bool:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(0.05)
    return False
