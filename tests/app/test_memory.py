"""Memory of the process."""

import subprocess
import sys
import time

import pytest

from instdrive_app.memory import MemoryGauge, read_resident_bytes, release_freed_memory

FREED = """
import numpy as np
from instdrive_app.memory import read_resident_bytes, release_freed_memory
kept = [np.ones(30_000, np.uint8) for _ in range(4_000)]
last = kept[-1]
del kept
before = read_resident_bytes()
release_freed_memory()
print(before - read_resident_bytes(), len(last))
"""


def test_the_gauge_reads_what_the_system_says():
    assert MemoryGauge().resident == pytest.approx(read_resident_bytes(), rel=0.1)
    release_freed_memory()  # harmless anywhere


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other C libraries have no such call")
def test_freed_memory_behind_a_block_in_use_goes_back():
    done = subprocess.run([sys.executable, "-c", FREED], capture_output=True, text=True, check=True)
    assert int(done.stdout.split()[0]) > 50e6


def test_memory_is_looked_up_once_a_second(monkeypatch):
    asked = []
    monkeypatch.setattr("instdrive_app.memory.read_resident_bytes", lambda: asked.append(1) or 5)
    now = time.monotonic()
    monkeypatch.setattr("instdrive_app.memory.time.monotonic", lambda: now)
    gauge = MemoryGauge()
    assert [gauge.resident, gauge.resident, len(asked)] == [5, 5, 1]
    now += 1.5
    assert [gauge.resident, len(asked)] == [5, 2]
