"""Every example runs on the sample scene and writes what it says."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from instdrive_core.formats.registry import open_scene
from instdrive_core.project.open import open_edited_scene

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
SAMPLE = EXAMPLES.parent / "assets" / "sample_scene"
WRITTEN = {
    "recolor_cars": ("recolored", "before.png", "after.png"),
    "clear_the_street": ("cleared.ply",),
    "move_a_car": ("moved.spz",),
    "repair_labels": ("labels.instdrive",),
    "edit_and_resume": ("session.instdrive",),
}


def test_every_example_is_listed_and_run():
    scripts = {path.stem for path in EXAMPLES.glob("*.py")} - {"scene_and_folder"}
    assert scripts == {*WRITTEN, "drive_in_a_loop"}
    text = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    assert all(f"`{name}.py`" in text for name in scripts)


def test_the_toy_planner_stops_before_the_parked_car_that_it_sees(tmp_path):
    command = [sys.executable, str(EXAMPLES / "drive_in_a_loop.py"), str(SAMPLE), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=500, check=False)
    assert done.returncode == 0, done.stderr
    steps = json.loads((tmp_path / "loop.json").read_text())
    assert steps[0]["speed"] == 10
    assert steps[0]["free"] == pytest.approx(24, abs=1)  # to its bumper
    assert steps[-1]["speed"] == 0
    assert steps[-1]["free"] == pytest.approx(6, abs=0.5)
    assert {path.name for path in tmp_path.iterdir()} == {"loop.json", "first.png", "last.png"}


@pytest.mark.parametrize("name", WRITTEN)
def test_example(name, tmp_path):
    command = [sys.executable, str(EXAMPLES / f"{name}.py"), str(SAMPLE), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=500, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout
    for written in WRITTEN[name]:
        path = tmp_path / written
        assert path.exists(), done.stdout
        if path.suffix != ".png":
            assert len(open_edited_scene(path) if path.suffix == ".instdrive" else open_scene(path)) > 50_000
