"""Every example runs on the sample scene and writes what it says."""

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
    assert scripts == WRITTEN.keys()
    text = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    assert all(f"`{name}.py`" in text for name in scripts)


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
