"""Moves, copies, adjustments and label repair with `instdrive apply`."""

import numpy as np
import pytest
from random_scene import random_scene

from instdrive_app.main import main
from instdrive_core.formats.registry import open_scene, save_scene


@pytest.fixture
def run(tmp_path):
    """A run folder with two moving actors (instances 7 and 8) and instances 1 to 6."""
    save_scene(tmp_path / "run", random_scene())
    return tmp_path / "run"


def test_edits_by_options(run, tmp_path):
    save_scene(tmp_path / "other.ply", random_scene(seed=1, count=40, actors=0))
    options = ["--insert", str(tmp_path / "other.ply"), "--merge", "4=5,6", "--set-class", "3=Van"]
    options += ["--adjust", "2=opacity:0.5", "--move", "2=1,0,-2", "3=0,0,0,90,2", "--duplicate", "1=0,6,0"]
    assert main(["apply", str(run), *options, "--delete", "1", "-o", str(tmp_path / "out")]) == 0
    before, after = random_scene(), open_scene(tmp_path / "out")
    mine, moved = (np.flatnonzero(scene.instance_ids == 2) for scene in (before, after))
    shift = after.gaussians.means[moved] - before.gaussians.means[mine]
    np.testing.assert_allclose(shift, np.tile([1, 0, -2], (len(mine), 1)), atol=1e-5)
    np.testing.assert_allclose(after.gaussians.opacities[moved], 0.5 * before.gaussians.opacities[mine], atol=1e-6)
    mine, turned = (np.flatnonzero(scene.instance_ids == 3) for scene in (before, after))
    old, new = (
        scene.gaussians.means[rows] - scene.gaussians.means[rows].mean(axis=0)
        for scene, rows in ((before, mine), (after, turned))
    )
    np.testing.assert_allclose(new, 2 * np.stack([-old[:, 1], old[:, 0], old[:, 2]], axis=1), atol=1e-4)
    assert after.table[3].class_name == "Van"
    assert {5, 6} & {instance.id for instance in after.table} == set()
    copied = [instance for instance in after.table if instance.name.startswith("parked – “taxi” (")]
    assert len(copied) == 1
    originals = before.gaussians.means[before.instance_ids == 1]
    copies = after.gaussians.means[after.instance_ids == copied[0].id]
    np.testing.assert_allclose(copies, originals + np.float32([0, 6, 0]), atol=1e-5)
    assert len(after) == 200 + 40 + len(copies) - len(originals)


def test_a_class_is_deleted_and_all_but_some_instances(run, tmp_path):
    before = random_scene()
    assert main(["apply", str(run), "--set-class", "3=Car", "--delete-class", "Car", "-o", str(tmp_path / "few")]) == 0
    cars = [1, 3, *(i.id for i in before.table if i.class_name == "Car")]
    assert len(open_scene(tmp_path / "few")) == (~np.isin(before.instance_ids, cars)).sum()
    assert main(["apply", str(run), "--keep", "2", "7", "-o", str(tmp_path / "kept")]) == 0
    kept = open_scene(tmp_path / "kept")
    assert np.unique(kept.instance_ids).tolist() == [2, 7]
    assert len(kept) == np.isin(before.instance_ids, [2, 7]).sum()


@pytest.mark.parametrize(
    ("option", "named"),
    [
        (["--move", "2=1,2"], "3 numbers"),
        (["--move", "2=1,2,nan"], "3 numbers"),
        (["--move", "77=1,2,3"], "77"),
        (["--adjust", "2=gloss:1"], "gloss"),
        (["--adjust", "2=hue:far"], "far"),
        (["--merge", "2=a"], "'a'"),
        (["--duplicate", "2"], "ID=VALUE"),
        (["--insert", "absent.ply"], "absent.ply"),
        (["--absorb", "77"], "77"),
        (["--delete-class", "Bicycle"], "classes are: Car"),
        (["--keep", "2", "77"], "77"),
        (["--split", "2", "--adjust", "2=hue:200"], "180"),
        (["--time", "nan"], "--time nan is no moment"),
    ],
)
def test_options_that_cannot_be_read_are_explained(run, tmp_path, capsys, option, named):
    assert main(["apply", str(run), *option, "-o", str(tmp_path / "out.ply")]) == 2
    assert named in capsys.readouterr().err
    assert not (tmp_path / "out.ply").exists()


def test_an_adjustment_replaces_an_earlier_one_of_its_kind(run, tmp_path):
    project = str(tmp_path / "street.instdrive")
    assert main(["apply", str(run), "--adjust", "2=opacity:0.5", "2=opacity:0.8", "-o", project]) == 0
    assert main(["apply", project, "--adjust", "2=opacity:0.25", "-o", str(tmp_path / "out")]) == 0
    before, after = random_scene(), open_scene(tmp_path / "out")
    rows = np.flatnonzero(before.instance_ids == 2)
    np.testing.assert_allclose(after.gaussians.opacities[rows], 0.25 * before.gaussians.opacities[rows], atol=1e-6)


@pytest.mark.parametrize(
    ("mine", "theirs", "options", "moved", "said"),
    [
        (
            (4e5, 5e6, 30),
            (4e5 + 12, 5e6 - 3, 31),
            [],
            (12, -3, 1),
            "placed where its coordinates have it, 12.00, -3.00",
        ),
        ((4e5, 5e6, 30), (4e5, 5e6 + 4000, 30), [], (0, 0, 0), "it lies 4.0 km away; its numbers are taken"),
        ((4e5, 5e6, 30), (0, 0, 0), [], (0, 0, 0), "other.ply: it says nothing of where its origin is"),
        ((0, 0, 0), (4e5, 5e6, 30), [], (0, 0, 0), "the scene says nothing of where its origin is"),
        ((4e5, 5e6, 30), (4e5 + 12, 5e6, 30), ["--scale", "1.5"], (0, 0, 0), "the scene was turned or scaled"),
        ((0, 0, 0), (0, 0, 0), [], (0, 0, 0), ""),
    ],
)
def test_a_scene_is_inserted_where_its_coordinates_have_it(tmp_path, capsys, mine, theirs, options, moved, said):
    scene, other = random_scene(actors=0), random_scene(seed=1, count=40, actors=0)
    scene.origin, other.origin = np.array(mine, float), np.array(theirs, float)
    save_scene(tmp_path / "run", scene)
    save_scene(tmp_path / "other.ply", other)
    command = ["apply", str(tmp_path / "run"), *options, "--insert", str(tmp_path / "other.ply")]
    assert main([*command, "-o", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert said in printed
    assert bool(said) == ("its numbers" in printed or "its own numbers" in printed)
    after = open_scene(tmp_path / "out")
    np.testing.assert_array_equal(after.origin, scene.origin)
    np.testing.assert_allclose(after.gaussians.means[200:], other.gaussians.means + np.float32(moved), atol=1e-4)
