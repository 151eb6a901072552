"""From a first start to an exported scene without one car, in few actions, by true mouse and keys."""

import json
import shutil
import subprocess
import sys

import pytest

pytestmark = pytest.mark.gui

MOST_ACTIONS = 8


@pytest.mark.slow
def test_a_car_is_deleted_filled_and_exported_in_few_actions():
    for tool in ("Xvfb", "xdotool"):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not installed")
    command = [sys.executable, "-m", "benchmarks.first_walk"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    walk = json.loads(done.stdout.splitlines()[-1])
    assert walk["count"] == len(walk["actions"]) <= MOST_ACTIONS, walk["actions"]
    assert walk["car"] > 0
    assert walk["car_is_gone"]
    assert walk["filled_splats"] > 100
