"""Videos of a recording: one of each camera and one of all, whole or absent."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from random_scene import random_scene

from instdrive_app.main import main
from instdrive_core.errors import OptionError
from instdrive_core.extras import MissingExtraError
from instdrive_core.formats.registry import save_scene
from instdrive_core.recording.drive import Drive
from instdrive_core.recording.folder import read_color, read_manifest
from instdrive_core.recording.plan import RecordOptions, plan_views
from instdrive_core.recording.record import record_drive
from instdrive_core.recording.videos import check_video_request, find_frame_rate, write_recorded_videos

av = pytest.importorskip("av")


def make_scene():
    """A scene of two cameras."""
    scene = random_scene(count=300)
    scene.views = (*scene.views, *(replace(view, name="left_camera") for view in scene.views))
    scene.gaussians.log_scales[:] = -1.2
    scene.gaussians.opacity_logits[:] = 3
    return scene


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    scene, folder = make_scene(), tmp_path_factory.mktemp("videos") / "out"
    record_drive(folder, Drive(scene, plan_views(scene, RecordOptions())))
    return folder


def read_frames(path):
    with av.open(path) as container:
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]


def test_each_camera_has_a_video_of_its_pictures(recorded):
    written = write_recorded_videos(recorded, "mp4")
    cameras = read_manifest(recorded)["cameras"]
    assert {path.stem for path in written} == {*cameras, *(["all_cameras"] if len(cameras) > 1 else [])}
    for camera in cameras:
        frames = read_frames(recorded / "videos/color" / f"{camera}.mp4")
        views = [view for view in read_manifest(recorded)["views"] if view["camera"] == camera]
        assert len(frames) == len(views)
        for frame, view in zip(frames, views, strict=True):
            truth = read_color(recorded / view["color"]).astype(float)
            assert np.abs(frame[: truth.shape[0], : truth.shape[1]] - truth).mean() < 12


def test_the_video_of_all_cameras_holds_each_picture(recorded):
    manifest = read_manifest(recorded)
    assert manifest["cameras"] == ["front_camera", "left_camera"]
    write_recorded_videos(recorded, "mp4")
    frames = read_frames(recorded / "videos/color/all_cameras.mp4")
    assert len(frames) == len(manifest["moments"])
    width = frames[0].shape[1]
    first = manifest["views"][0]
    columns = round(width / (first["width"] + first["width"] % 2))
    assert columns == int(np.ceil(np.sqrt(len(manifest["cameras"]))))
    truth = read_color(recorded / first["color"]).astype(float)
    corner = frames[0][: truth.shape[0], : truth.shape[1]]
    below = slice(truth.shape[0] // 3, None)  # the name stands above
    assert np.abs(corner[below] - truth[below]).mean() < 12


def test_instances_and_depth_have_videos_of_their_own_and_whole_files_are_kept(recorded):
    written = write_recorded_videos(recorded, "webm", ("instances", "depth"))
    assert {path.parent.name for path in written} == {"instances", "depth"}
    before = {path: path.stat().st_mtime_ns for path in written}
    assert write_recorded_videos(recorded, "webm", ("instances", "depth")) == written
    assert {path: path.stat().st_mtime_ns for path in written} == before


def test_a_stopped_video_leaves_no_file(recorded, monkeypatch):
    def fail(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("instdrive_core.recording.videos.colorize_depth", fail)
    with pytest.raises(KeyboardInterrupt):
        write_recorded_videos(recorded, "mp4", ("depth",))
    assert not [path for path in (recorded / "videos/depth").iterdir() if path.suffix == ".mp4"]


def test_frames_pass_as_fast_as_moments():
    assert find_frame_rate([0.0, 0.1, 0.2, 0.3]) == pytest.approx(10)
    assert find_frame_rate([3.0]) == 1
    assert find_frame_rate([0.0, 5.0]) == 1


def test_wrong_kinds_and_a_missing_package_are_told_first(monkeypatch):
    with pytest.raises(OptionError, match=r"cannot end in \.avi; choose mp4 or webm"):
        check_video_request(["avi"])
    check_video_request([])
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(MissingExtraError, match=r"instdrive\[video\]"):
        check_video_request(["mp4"])


def test_the_command_writes_videos(tmp_path, capsys):
    save_scene(tmp_path / "scene", make_scene())
    out = tmp_path / "out"
    assert main(["simulate", str(tmp_path / "scene"), "-o", str(out), "--width", "32", "--video", "mp4"]) == 0
    assert f"videos: {out / 'videos'}" in capsys.readouterr().out
    assert list((out / "videos/color").glob("*.mp4"))
