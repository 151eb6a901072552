"""What a killed driver leaves behind is ended, and nothing else."""

import subprocess
import sys

import psutil

from instdrive_core.fleet import reaper


def test_only_processes_of_that_number_and_birth_are_ended(monkeypatch):
    monkeypatch.setattr(reaper, "_PATIENCE", 0.2)
    command = [sys.executable, "-c", "import time; time.sleep(60)"]
    left, other = subprocess.Popen(command), subprocess.Popen(command)
    try:
        births = [psutil.Process(process.pid).create_time() for process in (left, other)]
        reaper.end_processes([f"{left.pid} {births[0]}", f"{other.pid} {births[1] - 100}", "999999999 5.0"])
        assert left.poll() is not None  # psutil has waited for it
        assert other.poll() is None
    finally:
        for process in (left, other):
            process.kill()
            process.wait()
