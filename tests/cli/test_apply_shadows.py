"""`instdrive apply --move … --no-shadows`, `--shadow` and `--complete`."""

import numpy as np
import pytest
from half_seen_car import CAR as HALF
from half_seen_car import half_seen_car
from parked_street import CAR, OTHER_CAR, ROAD, parked_street

from instdrive_app.main import main
from instdrive_core.formats.registry import open_scene, save_scene

MOVE = ["--move", f"{CAR}=-3.5,0,0"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("parked") / "scene"
    save_scene(path, parked_street().scene)
    return path


def shadowed(path):
    scene = open_scene(path)
    if "synthetic" not in scene.extra:
        return set()
    return set(np.unique(scene.instance_ids[scene.extra["synthetic"] == 2]).tolist())


def test_what_is_moved_gets_a_shadow_unless_it_is_to_have_none(folder, tmp_path, capsys):
    assert main(["apply", str(folder), *MOVE, "-o", str(tmp_path / "a.ply")]) == 0
    assert "1 shadow laid: " in capsys.readouterr().out
    assert shadowed(tmp_path / "a.ply") == {CAR}
    assert main(["apply", str(folder), *MOVE, "--no-shadows", "-o", str(tmp_path / "b.ply")]) == 0
    assert shadowed(tmp_path / "b.ply") == set()
    assert "shadow" not in capsys.readouterr().out


def test_copies_have_one_and_projects_keep_it(folder, tmp_path):
    project = tmp_path / "kept.instdrive"
    assert main(["apply", str(folder), "--duplicate", f"{CAR}=-3.5,0,0", "-o", str(project)]) == 0
    assert main(["apply", str(project), "-o", str(tmp_path / "a.ply")]) == 0
    (copy,) = shadowed(tmp_path / "a.ply")
    assert copy not in (CAR, OTHER_CAR)


def test_what_reaches_into_another_thing_is_told(folder, tmp_path, capsys):
    assert main(["apply", str(folder), "--move", f"{CAR}=0,3,0", "-o", str(tmp_path / "a.ply")]) == 0
    assert "overlap: Car 7 reaches 0." in capsys.readouterr().out
    assert main(["apply", str(folder), *MOVE, "-o", str(tmp_path / "b.ply")]) == 0
    assert "overlap" not in capsys.readouterr().out


def test_a_small_or_floating_move_has_none(folder, tmp_path):
    for number, shift in enumerate(("0.2,0,0", "-3.5,0,4")):
        out = tmp_path / f"{number}.ply"
        assert main(["apply", str(folder), "--move", f"{CAR}={shift}", "-o", str(out)]) == 0
        assert shadowed(out) == set()


def test_one_is_laid_on_request_or_refused(folder, tmp_path, capsys):
    assert main(["apply", str(folder), "--shadow", str(OTHER_CAR), "-o", str(tmp_path / "a.ply")]) == 0
    assert shadowed(tmp_path / "a.ply") == {OTHER_CAR}
    assert main(["apply", str(folder), "--shadow", str(ROAD), "-o", str(tmp_path / "b.ply")]) == 2
    assert f"--shadow: instance {ROAD} is a surface" in capsys.readouterr().err
    assert main(["apply", str(folder), "--shadow", "99", "-o", str(tmp_path / "b.ply")]) == 2
    assert "99" in capsys.readouterr().err
    assert not (tmp_path / "b.ply").exists()


def test_an_unseen_side_is_completed_or_refused(folder, tmp_path, capsys):
    save_scene(tmp_path / "half", half_seen_car())
    assert main(["apply", str(tmp_path / "half"), "--complete", str(HALF), "-o", str(tmp_path / "a.ply")]) == 0
    assert (open_scene(tmp_path / "a.ply").extra["synthetic"] == 3).any()
    assert main(["apply", str(folder), "--complete", str(CAR), "-o", str(tmp_path / "b.ply")]) == 2
    assert "both sides of Car 7 were seen" in capsys.readouterr().err
