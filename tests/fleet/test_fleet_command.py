"""The command itself: a true Ray on this machine, with idle clips; and options that are refused."""

import json
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import pytest
from small_clip import write_small_clip

from instdrive_app.main import main

needs_ray = pytest.mark.skipif(find_spec("ray") is None, reason="needs ray: pip install 'instdrive[fleet]'")
PATIENCE = 120.0
IDLE = """
import sys
from instdrive_core.fleet import workers

def work(task):
    import os
    from pathlib import Path
    from instdrive_core.fleet.clip_work import ClipOutcome
    if task.clip.name == "bad":
        return ClipOutcome("failed", "no data set")
    tries = Path(task.runs) / task.clip.name
    tries.mkdir(parents=True, exist_ok=True)
    (tries / str(os.getpid())).touch()
    if task.clip.name == "lost" and len(list(tries.iterdir())) == 1:
        os.kill(os.getpid(), 9)
    return ClipOutcome("done")

workers.work_on_clip = work
from instdrive_app.main import main
sys.exit(main(sys.argv[1:]))
"""
"""The command with workers that train nothing; the first that gets the clip ``lost`` is killed."""


@pytest.mark.slow
@needs_ray
def test_workers_of_ray_are_lost_and_replaced(tmp_path):
    clips = [str(tmp_path / name) for name in ("lost", "bad")]
    arguments = ["fleet", *clips, "-o", str(tmp_path / "runs"), "--cpus-per-clip", "1"]
    done = subprocess.run(
        [sys.executable, "-c", IDLE, *arguments], capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    assert done.returncode == 2, done.stderr
    assert done.stderr.strip().endswith("1 of 2 clips failed: bad (no data set)")
    known = {clip["name"]: clip for clip in json.loads((tmp_path / "runs" / "fleet.json").read_text())["clips"]}
    assert {name: clip["status"] for name, clip in known.items()} == {"lost": "done", "bad": "failed"}
    assert "the worker was lost" in known["lost"]["attempts"][0]["problem"]
    workers = [int(file.name) for file in (tmp_path / "runs" / "lost").iterdir()]
    assert len(workers) == 2
    end = time.monotonic() + PATIENCE
    while any(map(is_alive, workers)) and time.monotonic() < end:
        time.sleep(0.05)
    assert not any(map(is_alive, workers))


def is_alive(process):
    status = Path(f"/proc/{process}/stat")
    return status.is_file() and status.read_text().rsplit(")", 1)[1].split()[0] != "Z"


@needs_ray
@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (["--minutes", "0"], "--minutes is 0.0"),
        (["--cpus-per-clip", "0"], "--cpus-per-clip is 0.0"),
        (["--retries", "-1"], "--retries is -1"),
        (["--iterations", "0"], "--iterations is 0"),
    ],
)
def test_options_that_mean_nothing_are_refused(options, complaint, tmp_path, capsys):
    clip = write_small_clip(tmp_path / "clip")
    assert main(["fleet", str(clip), "-o", str(tmp_path / "runs"), *options]) == 2
    assert complaint in capsys.readouterr().err
    assert not (tmp_path / "runs").exists()
