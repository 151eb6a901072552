"""Parts of a scene with `instdrive apply`: some instances, each instance, each actor."""

import json

import numpy as np
import pytest
from random_scene import random_scene

from instdrive_app.main import main
from instdrive_core.formats.objects.poses import read_poses
from instdrive_core.formats.registry import open_scene, save_scene


@pytest.fixture
def run(tmp_path):
    """A run folder with two moving actors (instances 7 and 8) and instances 1 to 6."""
    save_scene(tmp_path / "run", random_scene())
    return tmp_path / "run"


def test_only_some_instances(run, tmp_path, capsys):
    assert main(["apply", str(run), "--only", "2", "8", "--delete", "3", "-o", str(tmp_path / "part.ply")]) == 0
    ids = random_scene().instance_ids
    assert np.unique(open_scene(tmp_path / "part.ply").instance_ids).tolist() == [2], "actor 8 comes at 0.2 s"
    assert main(["apply", str(run), "--only", "2", "8", "-o", str(tmp_path / "part")]) == 0
    part = open_scene(tmp_path / "part")
    assert len(part) == np.isin(ids, [2, 8]).sum()
    assert ([actor.id for actor in part.actors], part.sky) == (["actor-1"], None)
    assert f"{len(part):,} splats, 2 instances" in capsys.readouterr().out


def test_each_instance_and_each_actor_besides_the_scene(run, tmp_path, capsys):
    options = ["--delete", "1", "--each", str(tmp_path / "each"), "--actors", str(tmp_path / "actors")]
    assert main(["apply", str(run), *options, "--time", "0.3", "-o", str(tmp_path / "out.splat")]) == 0
    listing = json.loads((tmp_path / "each" / "instances.json").read_text())["instances"]
    assert [entry["id"] for entry in listing] == [2, 3, 4, 5, 6, 7, 8]
    sizes = [len(open_scene(tmp_path / "each" / entry["file"])) for entry in listing]
    assert sizes == [entry["count"] for entry in listing]
    unnumbered = np.count_nonzero(random_scene().instance_ids == 0)
    assert sum(sizes) + unnumbered == len(open_scene(tmp_path / "out.splat"))
    assert all(entry["file"].endswith(".splat") for entry in listing)
    _, _, splats = read_poses(tmp_path / "actors" / "002_Car.poses.json")
    assert len(open_scene(splats)) == listing[-1]["count"]
    assert f"2 files, {listing[-2]['count'] + listing[-1]['count']} splats, with poses" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--only", "77", "-o", "{}/a.ply"], "no instance 77"),
        (["--only", "2", "-o", "{}/a.instdrive"], "whole scene"),
        (["--each", "{}/run/scene.json", "-o", "{}/a.ply"], "this is a file"),
    ],
)
def test_what_cannot_be_is_told(run, tmp_path, capsys, options, told):
    assert main(["apply", str(run), *(option.format(tmp_path) for option in options)]) == 2
    assert told in capsys.readouterr().err


def test_nothing_to_take_apart(tmp_path, capsys):
    save_scene(tmp_path / "bare.ply", random_scene(instances=0, actors=0))
    for option, told in (("--each", "no instances"), ("--actors", "no moving objects")):
        out = ["-o", str(tmp_path / "out.ply")]
        assert main(["apply", str(tmp_path / "bare.ply"), option, str(tmp_path / "parts"), *out]) == 2
        assert told in capsys.readouterr().err
