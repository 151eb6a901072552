"""The scripted session: the same editor, window and picking code, playing itself without a display."""

import json
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image
from plyfile import PlyData
from procedural_street import procedural_street

from instdrive_app.demo.script import ScriptError, find_inner_pixel
from instdrive_app.demo.showpiece import is_car, is_object_sized, rank_objects
from instdrive_app.shell.display import DisplayError
from instdrive_app.shell.virtual_display import open_virtual_display
from instdrive_core.formats.registry import save_scene
from instdrive_core.instances.colormap import ids_from_colors
from instdrive_core.instances.table import Instance


def play(scene, out):
    """In a process of its own: a window and the tests' off-screen context do not share one."""
    code = (
        "import sys; from instdrive_app.demo.script import run_scripted_session as run; run(sys.argv[1], sys.argv[2])"
    )
    environment = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    command = [sys.executable, "-c", code, str(scene), str(out)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=500, check=False)


@pytest.mark.gui
def test_a_session_plays_itself_and_leaves_its_pictures(tmp_path):
    if shutil.which("Xvfb") is None:
        pytest.skip("Xvfb is not installed")
    scene, out = procedural_street(), tmp_path / "out"
    save_scene(tmp_path / "street", scene)
    result = play(tmp_path / "street", out)
    assert result.returncode == 0, result.stderr
    told = json.loads((out / "session.json").read_text())
    pictures = {name: np.asarray(Image.open(out / name)) for name in told["pictures"]}
    assert set(pictures) == {
        *("color.png", "id_map.png", "hover.png", "selected.png", "editor.png"),
        *("tinted.png", "deleted.png", "cleaned.png", "recolored.png"),
    }
    assert pictures["editor.png"].shape == (720, 1280, 3)
    picked, recolored = tuple(told["picked_pixel"][::-1]), tuple(told["recolored_pixel"][::-1])
    ids = ids_from_colors(pictures["id_map.png"])
    assert set(np.unique(ids)) - {0} <= set(scene.table.instances)
    assert ids[picked] == told["picked_id"]
    assert ids[recolored] == told["recolored_id"] != told["picked_id"]
    at_picked = [tuple(pictures[f"{name}.png"][picked]) for name in ("color", "tinted", "deleted", "selected")]
    assert len(set(at_picked)) == 4
    assert tuple(pictures["recolored.png"][recolored]) != tuple(pictures["color.png"][recolored])
    left = PlyData.read(out / told["exported"])["vertex"]["instance_id"]
    assert told["picked_id"] not in left
    kept = len(scene) - scene.table[told["picked_id"]].count - told["residue"]
    assert len(left) == told["exported_splats"] <= kept + told["filled"], "the fill replaces what no photo reached"
    assert len(left) > 0.95 * (kept + told["filled"])
    assert (told["filled"] > 0) == (told["hole"] > 0)


@pytest.mark.gui
def test_a_scene_that_cannot_be_opened_ends_the_session_with_its_error(tmp_path):
    if shutil.which("Xvfb") is None:
        pytest.skip("Xvfb is not installed")
    (tmp_path / "broken.ply").write_bytes(b"ply\nnonsense")
    result = play(tmp_path / "broken.ply", tmp_path / "out")
    assert result.returncode != 0
    assert "ScriptError" in result.stderr
    assert "broken.ply" in result.stderr


def test_the_middle_of_a_mask_is_its_deepest_pixel():
    mask = np.zeros((40, 60), bool)
    mask[10:31, 20:31] = True
    mask[0, 59] = True
    x, y = find_inner_pixel(mask)
    assert x == 25.5
    assert 15 <= y <= 26
    assert find_inner_pixel(np.ones((3, 3), bool)) == (1.5, 1.5)
    with pytest.raises(ScriptError):
        find_inner_pixel(np.zeros((3, 3), bool))


def test_cars_rank_before_other_things_and_surfaces_are_none():
    scene = procedural_street(0.5)
    ids = np.zeros((100, 100), np.uint32)
    ids[:30], ids[30:60], ids[60:64], ids[64:70], ids[70:] = 1, 31, 10, 11, 0
    assert rank_objects(scene, ids) == [11, 10, 31]
    ids[:] = 11
    assert rank_objects(scene, ids) == [], "too near to make a picture"


@pytest.mark.parametrize(
    ("name", "class_name", "expected"),
    [("thing", "Car", True), ("my car", "", True), ("instance 4", "Carport", False), ("car", "Road", False)],
)
def test_cars_are_known_by_class_or_name(name, class_name, expected):
    assert is_car(Instance(1, name, class_name=class_name)) is expected


def test_object_sizes():
    sizes = {(1.8, 4.4, 1.5): True, (60.0, 8.0, 0.1): False, (0.1, 0.1, 0.2): False}
    for size, expected in sizes.items():
        assert is_object_sized(Instance(1, "", bounds=((0.0, 0.0, 0.0), size))) is expected


def test_without_xvfb_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setenv("PATH", "")
    with pytest.raises(DisplayError, match="apt install xvfb"), open_virtual_display():
        pass
