"""Some random use of the real window; `python -m benchmarks.monkey` does more of it."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.gui

ACTIONS = 40


@pytest.mark.slow
def test_a_monkey_breaks_nothing():
    for tool in ("Xvfb", "xdotool"):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not installed")
    command = [sys.executable, "-m", "benchmarks.monkey", "--actions", str(ACTIONS), "--seconds", "300", "--seed", "11"]
    root = Path(__file__).resolve().parents[3]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, timeout=500, check=False)
    assert done.stdout, done.stderr
    result = json.loads(done.stdout.splitlines()[-1])
    assert result["problems"] == []
    assert result["actions"] == ACTIONS
