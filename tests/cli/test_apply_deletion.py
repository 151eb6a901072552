"""`instdrive apply --delete 7 --report --absorb-residue --fill-holes`."""

import re

import pytest
from parked_street import CAR, parked_street

from instdrive_app.main import main
from instdrive_core.formats.registry import open_scene, save_scene


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("parked") / "scene"
    save_scene(path, parked_street().scene)
    return path


def test_a_deletion_is_reported(folder, tmp_path, capsys):
    assert main(["apply", str(folder), "--delete", str(CAR), "--report", "-o", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert re.search(r"deleted Car 7: 4\d splats of residue, hole of \d+\.\d m²\n", printed)
    assert re.search(r"residue that belongs to instance 2 \(pavement\): 4\d\n", printed)
    assert "synthetic" not in open_scene(tmp_path / "out").extra


def test_holes_are_filled_and_residue_goes(folder, tmp_path, capsys):
    out = tmp_path / "out.ply"
    options = ["--delete", str(CAR), "--absorb-residue", "--fill-holes", "-o", str(out)]
    assert main(["apply", str(folder), *options]) == 0
    assert "fill hole of" in capsys.readouterr().out
    filled = open_scene(out)
    entry = next(instance for instance in filled.table if instance.name == "fill of Car 7")
    assert filled.extra["synthetic"].sum() == entry.count
    assert main(["apply", str(folder), "--delete", str(CAR), "--absorb", str(CAR), "-o", str(tmp_path / "a.ply")]) == 0
    bare = open_scene(tmp_path / "a.ply")
    assert filled.table[2].count <= bare.table[2].count, "what no photo reached goes, too"


def test_without_a_deletion_there_is_nothing_to_tell(folder, tmp_path, capsys):
    assert main(["apply", str(folder), "--report", "-o", str(tmp_path / "out.ply")]) == 2
    assert "--delete" in capsys.readouterr().err
    assert not (tmp_path / "out.ply").exists()


def test_all_things_of_a_class_leave_one_report(folder, tmp_path, capsys):
    options = ["--delete-class", "Car", "--report", "--fill-holes"]
    assert main(["apply", str(folder), *options, "-o", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert re.search(r"deleted 2 instances: 4\d splats of residue, hole of \d+\.\d m²\n", printed)
    assert re.search(r"fill hole of \d+\.\d m² \(fill of 2 instances\): done\n", printed)
