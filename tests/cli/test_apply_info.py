"""`instdrive apply` and `instdrive info` as a user calls them."""

import json

import numpy as np
import pytest
from plyfile import PlyData
from random_scene import random_scene

from instdrive_app.main import main
from instdrive_core.cli.arguments import find_default_time, find_named_view
from instdrive_core.errors import OptionError
from instdrive_core.formats.registry import open_scene, save_scene


@pytest.fixture
def run(tmp_path):
    """A run folder with two moving actors (instances 7 and 8) and instances 1 to 6."""
    save_scene(tmp_path / "run", random_scene())
    return tmp_path / "run"


def test_delete_and_recolor_into_a_ply(run, tmp_path, capsys):
    out = tmp_path / "edited.ply"
    arguments = ["--delete", "1", "4", "--recolor", "2=#d02020", "3=#20a040", "--recolor-mode", "solid"]
    assert main(["apply", str(run), *arguments, "--time", "0.3", "-o", str(out)]) == 0
    assert "edited.ply" in capsys.readouterr().out
    ply, scene = PlyData.read(str(out))["vertex"], random_scene()
    kept = ~np.isin(scene.instance_ids, [1, 4])
    np.testing.assert_array_equal(ply["instance_id"], scene.instance_ids[kept])
    for instance_id, color in ((2, [0xD0, 0x20, 0x20]), (3, [0x20, 0xA0, 0x40])):
        rows = ply["instance_id"] == instance_id
        shown = [0.5 + 0.28209479177387814 * ply[f"f_dc_{channel}"][rows] for channel in range(3)]
        np.testing.assert_allclose(np.stack(shown, axis=1) * 255, np.tile(color, (rows.sum(), 1)), atol=1e-3)
        assert not any(ply[f"f_rest_{index}"][rows].any() for index in range(45))
    untouched = np.isin(ply["instance_id"], [5, 6])
    before = np.isin(scene.instance_ids, [5, 6])
    for axis, name in enumerate("xyz"):
        assert ply[name][untouched].tobytes() == scene.gaussians.means[before, axis].tobytes()
    np.testing.assert_array_equal(
        ply["f_rest_44"][untouched].view(np.uint32), scene.gaussians.sh_rest[before, 14, 2].view(np.uint32)
    )


def test_a_folder_keeps_tracks_and_views(run, tmp_path):
    assert main(["apply", str(run), "--delete", "7", "--rename", "8=white van", "-o", str(tmp_path / "out")]) == 0
    result = open_scene(tmp_path / "out")
    assert len(result.actors) == 2
    assert len(result.views) == 5
    assert 7 not in result.table
    assert result.table[8].name == "white van"


def test_a_ply_of_moving_objects_says_which_moment_it_holds(run, tmp_path, capsys):
    assert main(["apply", str(run), "-o", str(tmp_path / "a.ply")]) == 0
    assert "at 0 s" in capsys.readouterr().out
    assert {instance.id for instance in open_scene(tmp_path / "a.ply").table} == {1, 2, 3, 4, 5, 6, 7}


def test_a_ply_opens_with_the_sky_and_the_camera_of_that_moment(run, tmp_path):
    for options, moment in (((), 0.0), (("--time", "0.3"), 0.3)):
        assert main(["apply", str(run), *options, "-o", str(tmp_path / "a.ply")]) == 0
        written, scene = open_scene(tmp_path / "a.ply"), random_scene()
        nearest = min(scene.views, key=lambda view: abs(view.time - moment)).camera
        np.testing.assert_allclose(written.start.world_from_camera, nearest.world_from_camera, atol=1e-6)
        assert written.sky is not None
    assert main(["apply", str(run), "--sibr", "-o", str(tmp_path / "b.ply")]) == 0
    assert open_scene(tmp_path / "b.ply").start is None


def test_edits_from_a_file(run, tmp_path):
    log = tmp_path / "edits.jsonl"
    entries = [
        {"kind": "select_instances", "ids": [2, 3]},
        {"kind": "delete_selected"},
        {"kind": "merge_instances", "ids": [4], "into": 5},
    ]
    log.write_text("".join(json.dumps(entry) + "\n" for entry in entries))
    assert main(["apply", str(run), "--edits", str(log), "--delete", "6", "-o", str(tmp_path / "out")]) == 0
    assert {instance.id for instance in open_scene(tmp_path / "out").table} == {1, 5, 7, 8}


@pytest.mark.parametrize(
    ("arguments", "messages"),
    [
        (["--delete", "17"], ["no instance 17", "8 (instance 8)", "instdrive info"]),
        (["--recolor", "17=#d02020"], ["no instance 17"]),
        (["--recolor", "2=red"], ["'red'", "#rrggbb"]),
        (["--recolor", "2=#d0202"], ["'#d0202'"]),
        (["--recolor", "#d02020"], ["ID=VALUE", "4=#d02020"]),
        (["--recolor", "-1=#d02020"], ["ID=VALUE"]),
        (["--rename", "2="], ["ID=VALUE"]),
        (["--rename", "17=x"], ["no instance 17"]),
        (["--edits", "absent.jsonl"], ["absent.jsonl"]),
        (["--delete", "2", "--recolor", "2=#d02020", "--edits", "LOG"], ["instance 2", "deleted already"]),
    ],
)
def test_what_cannot_be_done_is_explained_and_nothing_written(run, tmp_path, capsys, arguments, messages):
    (tmp_path / "log.jsonl").write_text('{"kind": "delete_instances", "ids": [2]}\n')
    arguments = [str(tmp_path / "log.jsonl") if word == "LOG" else word for word in arguments]
    assert main(["apply", str(run), *arguments, "-o", str(tmp_path / "out.ply")]) == 2
    text = capsys.readouterr().err
    assert "Traceback" not in text
    for message in messages:
        assert message in text
    assert not (tmp_path / "out.ply").exists()


def test_a_scene_without_instances_says_so(tmp_path, capsys):
    save_scene(tmp_path / "a", random_scene(instances=0, actors=0))
    assert main(["apply", str(tmp_path / "a"), "--delete", "1", "-o", str(tmp_path / "b")]) == 2
    assert "has no instances" in capsys.readouterr().err


def test_info_prints_what_the_scene_holds(run, capsys):
    assert main(["info", str(run), "--instances", "3"]) == 0
    text = capsys.readouterr().out
    for word in ("200", "SH degree 3", "4 per splat", "8, on", "5 photos", "front_camera", "confidence", "and 5 more"):
        assert word in text
    assert main(["info", str(run.parent / "absent.ply")]) == 2


def test_info_of_damaged_and_empty_scenes(tmp_path, capsys):
    scene = random_scene(actors=0)
    scene.gaussians.means[3] = np.nan
    scene.gaussians.log_scales[4] = np.inf
    save_scene(tmp_path / "a.ply", scene)
    assert main(["info", str(tmp_path / "a.ply")]) == 0
    text = capsys.readouterr().out
    assert "2 splats hold values that are not finite (means of 1, log_scales of 1) (rows 3, 4). Best deleted" in text
    save_scene(tmp_path / "b.ply", random_scene(count=0, actors=0))
    assert main(["info", str(tmp_path / "b.ply")]) == 0


def test_views_are_found_by_name_and_number():
    scene = random_scene()
    assert find_named_view(scene, "front_camera/3") is scene.views[3]
    assert find_named_view(scene, "front_camera/03") is scene.views[3]
    with pytest.raises(OptionError, match=r"near it are front_camera/.*orbit"):
        find_named_view(scene, "front_camera/9")
    with pytest.raises(OptionError, match="front_camera/0"):
        find_named_view(scene, "zzz")
    assert find_default_time(scene) == 0
