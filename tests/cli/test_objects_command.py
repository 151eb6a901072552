"""``instdrive objects``: from any scene file to boxes and hulls."""

import json
from dataclasses import replace

import pytest
import trimesh
from random_scene import random_scene

from instdrive_app.main import main
from instdrive_core.formats.registry import save_scene


@pytest.fixture
def folder(tmp_path):
    save_scene(tmp_path / "scene", random_scene(count=600))
    return tmp_path / "scene"


def test_boxes_of_a_run_folder(folder, tmp_path, capsys):
    assert main(["objects", str(folder), "-o", str(tmp_path / "a.json")]) == 0
    content = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    assert len(content["objects"]) == 8
    assert content["time"] == 0
    printed = capsys.readouterr().out
    assert "8 objects at 0 s" in printed
    assert "1 of them are not there" in printed, "the second actor's track begins at 0.2 s"


def test_hulls_at_a_time(folder, tmp_path, capsys):
    assert main(["objects", str(folder), "-o", str(tmp_path / "a.glb"), "--shape", "hull", "--time", "0.3"]) == 0
    assert len(trimesh.load(tmp_path / "a.glb").geometry) == 8
    assert "8 objects at 0.3 s" in capsys.readouterr().out


def test_a_file_of_one_moment(tmp_path, capsys):
    scene = random_scene(actors=0)
    save_scene(tmp_path / "a.ply", replace(scene, views=()))
    assert main(["objects", str(tmp_path / "a.ply"), "-o", str(tmp_path / "a.json")]) == 0
    assert f"{len(scene.table)} objects\n" in capsys.readouterr().out


def test_a_project_is_exported_as_edited(folder, tmp_path, capsys):
    project = str(tmp_path / "a.instdrive")
    assert main(["apply", str(folder), "-o", project, "--delete", "1", "--rename", "2=bench"]) == 0
    assert main(["objects", project, "-o", str(tmp_path / "a.json")]) == 0
    names = {entry["id"]: entry["name"] for entry in json.loads((tmp_path / "a.json").read_bytes())["objects"]}
    assert 1 not in names
    assert names[2] == "bench"
    assert main(["id-masks", project, "-o", str(tmp_path / "masks"), "--every", "5"]) == 0
    listed = json.loads((tmp_path / "masks" / "instances.json").read_bytes())["instances"]
    assert [entry["id"] for entry in listed] == sorted(names)
    assert "masks of 1 photo," in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "problem"), [("a.obj", "ends in '.obj'"), ("a", "ends in 'nothing'"), ("missing/a.ply", "ends in '.ply'")]
)
def test_other_endings_are_refused_before_anything_is_read(folder, tmp_path, capsys, name, problem):
    assert main(["objects", str(folder / "nowhere"), "-o", str(tmp_path / name)]) == 2
    assert problem in capsys.readouterr().err


def test_a_scene_without_instances(tmp_path, capsys):
    save_scene(tmp_path / "a.splat", random_scene(actors=0))
    assert main(["objects", str(tmp_path / "a.splat"), "-o", str(tmp_path / "a.json")]) == 2
    assert "no instances" in capsys.readouterr().err
