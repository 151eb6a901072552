"""Other cameras on the recorded way: kept, moved, turned, with other lenses, and new ones."""

import json

import numpy as np
import pytest
from parked_street import parked_street

from instdrive_app.main import main
from instdrive_core.errors import DataError, OptionError
from instdrive_core.formats.registry import save_scene
from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.recording.camera_rig import read_camera_rig
from instdrive_core.recording.ego_path import EgoChange
from instdrive_core.recording.folder import read_color
from instdrive_core.recording.plan import RecordOptions, plan_views
from instdrive_core.sweeps.rig import build_rig

RIG = [
    {"name": "front_camera", "like": "front_camera"},
    {"name": "high", "like": "front_camera", "move_m": [0, 0, 0.8], "pitch_deg": -10},
    {"name": "wide", "like": "right_camera", "width": 80, "height": 60, "field_deg": 90},
    {"name": "left", "place_m": [0.2, 1.1, -0.4], "yaw_deg": 90, "width": 64, "height": 40, "field_deg": 60},
]


@pytest.fixture(scope="module")
def scene():
    return parked_street().scene


@pytest.fixture
def rig(tmp_path):
    """Writes a file of cameras."""

    def write(cameras):
        path = tmp_path / "rig.json"
        path.write_text(json.dumps({"cameras": cameras}))
        return path

    return write


def find(views, name, step):
    return next(view for view in views if (view.name, view.index) == (name, step))


def test_cameras_are_kept_moved_turned_and_given_lenses(scene, rig):
    views = plan_views(scene, RecordOptions(rig=rig(RIG)))
    assert [view.name for view in views[:4]] == ["front_camera", "high", "wide", "left"]
    assert len(views) == 4 * 12
    frame = build_rig(scene.views)
    for step in (0, 5):
        own, right = find(scene.views, "front_camera", step), find(scene.views, "right_camera", step)
        assert find(views, "front_camera", step) == own
        forward, left, up = frame.world_from_rig[step][:3, :3].T
        high = find(views, "high", step)
        np.testing.assert_allclose(high.camera.position, own.camera.position + 0.8 * up, atol=1e-9)
        axes, lowered = own.camera.world_from_camera[:3, :3], high.camera.world_from_camera[:3, :3]
        assert lowered[:, 2] @ axes[:, 2] == pytest.approx(np.cos(np.radians(10)))
        assert lowered[:, 2] @ axes[:, 1] == pytest.approx(np.sin(np.radians(10)))  # down
        assert (high.photo, high.camera.fx) == ("", own.camera.fx)
        wide = find(views, "wide", step).camera
        np.testing.assert_allclose(wide.world_from_camera, right.camera.world_from_camera, atol=1e-9)
        assert (wide.fx, wide.fy, wide.cx, wide.cy, wide.width, wide.height) == pytest.approx((40, 40, 40, 30, 80, 60))
        mirror = find(views, "left", step)
        middle = frame.world_from_rig[step][:3, 3]
        np.testing.assert_allclose(mirror.camera.position, middle + 0.2 * forward + 1.1 * left - 0.4 * up, atol=1e-9)
        np.testing.assert_allclose(mirror.camera.world_from_camera[:3, 2], left, atol=1e-9)
        np.testing.assert_allclose(mirror.camera.world_from_camera[:3, 1], -up, atol=1e-9)
        assert mirror.time == pytest.approx(0.1 * step)


def test_rolling_to_the_right_lowers_the_right_side(scene, rig):
    views = plan_views(scene, RecordOptions(rig=rig([{"name": "a", "like": "front_camera", "roll_deg": 20}])))
    own, rolled = scene.views[0].camera.world_from_camera, views[0].camera.world_from_camera
    assert rolled[:3, 0] @ own[:3, 1] == pytest.approx(np.sin(np.radians(20)))


def test_the_rig_goes_another_way_and_names_its_cameras(scene, rig):
    options = RecordOptions(rig=rig(RIG), cameras=("left",), ego=(EgoChange("shift", 1.0),), width=32, last=3)
    views = plan_views(scene, options)
    assert [(view.name, view.index, view.camera.width) for view in views] == [("left", step, 32) for step in range(4)]
    unmoved = plan_views(scene, RecordOptions(rig=rig(RIG), cameras=("left",)))
    apart = np.linalg.norm(views[0].camera.position - unmoved[0].camera.position)
    assert apart == pytest.approx(1.0, abs=1e-6)
    with pytest.raises(OptionError, match="the rig has no camera 'right_camera'; it has front_camera, high"):
        plan_views(scene, RecordOptions(rig=rig(RIG), cameras=("right_camera",)))


LENS = {"width": 64, "height": 40, "field_deg": 60}
WRONG = {
    "no list": ({}, "'cameras' is not a list of 1 to 64"),
    "none": ([], "'cameras' is not a list of 1 to 64"),
    "no name": ([LENS], r"'cameras\[0\].name' is missing"),
    "a path": ([{"name": "../x", "like": "front_camera"}], "'../x', which cannot be a folder's name"),
    "twice": ([{"name": "a", "like": "front_camera"}] * 2, "two cameras are called 'a'"),
    "typo": ([{"name": "a", "like": "front_camera", "yaw": 3}], r"'cameras\[0\].yaw' is not known"),
    "nowhere": ([{"name": "a", **LENS}], "camera 'a' has neither 'like' nor 'place_m'"),
    "no lens": ([{"name": "a", "place_m": [0, 0, 0]}], "has neither 'like' nor 'width'"),
    "half a lens": ([{"name": "a", "like": "front_camera", "width": 90}], r"'cameras\[0\].height' is missing"),
    "flat": (
        [{"name": "a", "like": "front_camera", **LENS, "height": 0}],
        "'cameras.0..height' is 0, expected a whole",
    ),
    "too wide": (
        [{"name": "a", "like": "front_camera", **LENS, "field_deg": 190}],
        "is 190, expected 1 to 150 degrees",
    ),
    "far away": ([{"name": "a", "place_m": [0, 900, 0], **LENS}], "expected three numbers up to 20 m"),
    "not a number": ([{"name": "a", "like": "front_camera", "yaw_deg": "left"}], "'left', expected a number"),
    "spun": ([{"name": "a", "like": "front_camera", "roll_deg": 1e9}], "expected degrees from -360 to 360"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_files_are_refused_by_field(rig, case):
    cameras, message = WRONG[case]
    with pytest.raises(DataError, match=message):
        read_camera_rig(rig(cameras))


def test_an_unknown_model_is_refused(scene, rig):
    with pytest.raises(DataError, match=r"'cameras\[0\].like' is 'rear'; the drive has front_camera, right_camera"):
        plan_views(scene, RecordOptions(rig=rig([{"name": "a", "like": "rear"}])))


def test_the_command_records_with_the_rig(scene, rig, tmp_path):
    save_scene(tmp_path / "scene", scene)
    out = tmp_path / "out"
    command = ["simulate", str(tmp_path / "scene"), "-o", str(out), "--rig", str(rig(RIG[2:])), "--last", "1"]
    assert main([*command, "--layout", "pandaset", "--shutter", "0.02", "--progress", "lines"]) == 0
    assert {path.name for path in (out / "color").iterdir()} == {"wide", "left"}
    view = find(plan_views(scene, RecordOptions(rig=rig(RIG))), "wide", 1)
    shown = view_scene(scene, view.camera, view.time).color
    recorded = read_color(out / "color/wide/01.png") / 255
    assert np.abs(recorded - np.clip(shown, 0, 1)).mean() < 0.03
    assert main(["info", str(out / "layouts/pandaset/drive")]) == 0
