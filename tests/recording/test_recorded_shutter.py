"""Drives recorded through a rolling shutter."""

import json
from dataclasses import replace

import numpy as np
import pytest
from random_scene import random_scene

from instdrive_app.main import main
from instdrive_core.edits.document.document import Document
from instdrive_core.errors import DataError, OptionError
from instdrive_core.formats.registry import save_scene
from instdrive_core.rasterize.rolling_shutter import view_through_shutter
from instdrive_core.rasterize.scene_view import build_instance_map, view_scene
from instdrive_core.recording.drive import take_drive
from instdrive_core.recording.ego_path import EgoChange
from instdrive_core.recording.folder import read_color, read_id_map
from instdrive_core.recording.plan import RecordOptions
from instdrive_core.recording.record import record_drive
from instdrive_core.recording.shutter import Shutter, build_rolling_rig, parse_shutter


@pytest.fixture(scope="module")
def scene():
    made = random_scene(count=300)
    made.gaussians.log_scales[:] = -1.2
    made.gaussians.opacity_logits[:] = 3
    return made


def test_pictures_masks_and_depth_are_those_of_the_lines_moments(scene, tmp_path):
    shutter = Shutter(0.06, "up")
    drive = take_drive(Document(scene), RecordOptions(shutter=shutter, confidence=True))
    manifest = record_drive(tmp_path / "out", drive)
    assert manifest["shutter"] == {"seconds": 0.06, "direction": "up"}
    view = scene.views[2]
    rolling = build_rolling_rig(shutter, scene.views).roll(view)
    assert (rolling.start_time, rolling.end_time) == (pytest.approx(0.17), pytest.approx(0.23))
    shown, still = view_through_shutter(scene, rolling), view_scene(scene, view.camera, view.time)
    color = read_color(tmp_path / "out" / "color/front_camera/02.png") / 255
    np.testing.assert_allclose(color, np.clip(shown.color, 0, 1), atol=0.51 / 255)
    assert np.abs(color - np.clip(still.color, 0, 1)).mean() > 0.01
    ids = read_id_map(tmp_path / "out" / "instances/front_camera/02.png")
    np.testing.assert_array_equal(ids, build_instance_map(scene, shown))
    depth = np.load(tmp_path / "out" / "depth/front_camera/02.npz")["depth"]
    np.testing.assert_array_equal(depth[shown.alpha >= 0.5], shown.depth[shown.alpha >= 0.5])


def test_cameras_move_between_steps_and_on_beyond_the_last(scene):
    rig = build_rolling_rig(Shutter(0.1), scene.views)
    places = np.stack([view.camera.position for view in scene.views])
    first, last = rig.roll(scene.views[0]), rig.roll(scene.views[-1])
    np.testing.assert_allclose(first.start[:3, 3], places[0] - 0.5 * (places[1] - places[0]), atol=1e-9)
    np.testing.assert_allclose(first.end[:3, 3], (places[0] + places[1]) / 2, atol=1e-9)
    np.testing.assert_allclose(last.end[:3, 3], places[-1] + 0.5 * (places[-1] - places[-2]), atol=1e-9)
    alone = build_rolling_rig(Shutter(0.1), scene.views[:1]).roll(scene.views[0])
    np.testing.assert_array_equal(alone.start, alone.end)


def test_the_camera_rolls_on_the_way_that_is_recorded(scene):
    stopped = take_drive(Document(scene), RecordOptions(shutter=Shutter(0.05), ego=(EgoChange("speed", 0.0),)))
    assert stopped.rolling is not None
    rolling = stopped.rolling.roll(stopped.views[2])
    np.testing.assert_allclose(rolling.start, rolling.end, atol=1e-9)


def test_another_shutter_is_another_recording(scene, tmp_path):
    options = RecordOptions(first=0, last=0)
    document = Document(scene)
    record_drive(tmp_path / "out", take_drive(document, replace(options, shutter=Shutter(0.03))))
    with pytest.raises(DataError):
        record_drive(tmp_path / "out", take_drive(document, replace(options, shutter=Shutter(0.04))))
    with pytest.raises(DataError):
        record_drive(tmp_path / "out", take_drive(document, options))


def test_flow_is_refused(scene):
    with pytest.raises(OptionError, match="leave out --flow or --shutter"):
        take_drive(Document(scene), RecordOptions(flow=True, shutter=Shutter(0.03)))


def test_shutters_are_read_from_text():
    assert parse_shutter("0.03") == Shutter(0.03, "down")
    assert parse_shutter(" 0.1@left ") == Shutter(0.1, "left")


@pytest.mark.parametrize("text", ["", "fast", "0.03@inwards", "0", "0.2", "-0.03", "1e-3", "nan"])
def test_other_shutters_are_refused(text):
    with pytest.raises(OptionError, match="shutter"):
        parse_shutter(text)


def test_the_command_records_through_a_shutter(scene, tmp_path, capsys):
    save_scene(tmp_path / "scene", scene)
    out = tmp_path / "out"
    command = ["simulate", str(tmp_path / "scene"), "-o", str(out), "--last", "0", "--progress", "lines"]
    assert main([*command, "--shutter", "0.04@right"]) == 0
    assert json.loads((out / "recording.json").read_text())["shutter"]["direction"] == "right"
    capsys.readouterr()
    assert main([*command, "--shutter", "9"]) == 2
    assert "'9': a shutter takes more than 0" in capsys.readouterr().err
