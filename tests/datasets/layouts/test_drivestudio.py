"""drivestudio's folders: the conventions of the data sets that it prepares, and files that are damaged."""

import json
import shutil

import numpy as np
import pytest
from PIL import Image
from small_clip import WHOLE, write_layout

from instdrive_core.datasets.clip_comparison import compare_clips
from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import DataError

WAYMO_FROM_OPENCV = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
TURN = np.array([[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
"""PandaSet's box, whose length lies along y, from a box of all others, whose length lies along x."""


@pytest.fixture
def folder(tmp_path):
    return write_layout("drivestudio", tmp_path / "clip")


def convert(folder, variant):
    """The folder as the preprocessing of another data set leaves it."""
    out = folder.parent / variant
    shutil.copytree(folder, out)
    poses = {file.stem: np.loadtxt(file) for file in (out / "ego_pose").iterdir()}
    points = {file: np.fromfile(file, np.float32).reshape(-1, 5) for file in (out / "lidar").iterdir()}
    turn_boxes(out)
    if variant == "nuscenes":
        (out / "ego_pose").rename(out / "lidar_pose")
        for file, rows in points.items():
            rows[:, :4].tofile(file)
        return out
    for camera in ("0", "1"):
        found = {file.stem[:-2]: file for file in (out / "extrinsics").glob(f"*_{camera}.txt")}
        step = min(found)
        placed = np.linalg.inv(poses[step]) @ np.loadtxt(found[step])
        axes = np.linalg.inv(WAYMO_FROM_OPENCV) if variant == "waymo" else np.eye(4)
        np.savetxt(out / "extrinsics" / f"{camera}.txt", placed @ axes)
        for file in found.values():
            file.unlink()
    for file, rows in points.items():
        empty = np.zeros((len(rows), 14), np.float32)
        empty[:, 3:6], empty[:, 11], empty[:, 13] = rows[:, :3], rows[:, 3] / 255, rows[:, 4]
        nuplan = np.column_stack([rows[:, :4], np.full(len(rows), 9), rows[:, 4]]).astype(np.float32)
        kitti = np.column_stack([rows[:, :3], rows[:, 3] / 255]).astype(np.float32)
        {"waymo": empty, "nuplan": nuplan, "kitti": kitti}[variant].tofile(file)
    return out


def turn_boxes(out):
    file = out / "instances" / "instances_info.json"
    content = json.loads(file.read_text())
    for entry in content.values():
        listed = entry["frame_annotations"]
        listed["obj_to_world"] = [(np.array(pose) @ TURN).tolist() for pose in listed["obj_to_world"]]
        listed["box_size"] = [[length, width, height] for width, length, height in listed["box_size"]]
    file.write_text(json.dumps(content))


@pytest.mark.parametrize("variant", ["waymo", "nuplan", "kitti", "nuscenes"])
def test_what_each_data_set_means_by_the_files_is_understood(folder, variant):
    first, second = load_clip(str(folder), WHOLE), load_clip(str(convert(folder, variant)), WHOLE)
    found = compare_clips(first, second, tuple(zip(first.camera_names, second.camera_names, strict=True)))
    assert found.pose_error < 1e-6
    assert found.point_error_m < 1e-3
    assert found.boxes == 10
    assert found.box_error_m < 1e-6
    sweeps = [clip.sweeps[0].load() for clip in (first, second)]
    np.testing.assert_allclose(sweeps[0].intensity, sweeps[1].intensity, atol=1e-6)
    if variant in ("waymo", "nuplan"):
        np.testing.assert_array_equal(sweeps[0].sensor, sweeps[1].sensor)


def test_what_is_not_there_is_said_or_left_out(folder):
    shutil.rmtree(folder / "instances")
    shutil.rmtree(folder / "lidar")
    (folder / "sky_masks").mkdir()
    clip = load_clip(str(folder), WHOLE)
    assert not clip.tracks
    assert not clip.sweeps
    assert any("no LiDAR" in note for note in clip.notes)
    assert any("not read: sky_masks" in note for note in clip.notes)
    assert any("no times" in note for note in clip.notes)


def use_rear_camera(folder, size):
    """Camera 1 becomes camera 5, whose photos have this size."""
    for part, endings in (("images", "jpg"), ("extrinsics", "txt"), ("intrinsics", "txt")):
        for file in (folder / part).glob(f"*1.{endings}"):
            if file.stem == "1" or file.stem.endswith("_1"):
                file.rename(file.with_name(f"{file.stem[:-1]}5.{endings}"))
    for file in (folder / "images").glob("*_5.jpg"):
        Image.new("RGB", size).save(file)


@pytest.mark.parametrize(
    ("size", "hidden"),
    [((1920, 1080), 258), ((1280, 720), 0)],
)
def test_the_recording_car_is_hidden_in_photos_of_pandasets_size(folder, size, hidden):
    use_rear_camera(folder, size)
    frames = load_clip(str(folder), WHOLE).frames
    assert {frame.view.name for frame in frames} == {"camera_0", "camera_5"}
    for frame in frames:
        shown = frame.valid
        if frame.view.name == "camera_0" or not hidden:
            assert shown is None
        else:
            assert shown[:-hidden].all()
            assert not shown[-hidden:].any()


def test_each_data_set_has_its_own_car(folder):
    use_rear_camera(convert(folder, "nuscenes"), (1600, 900))
    frames = load_clip(str(folder.parent / "nuscenes"), WHOLE).frames
    assert [frame.valid.sum() for frame in frames if frame.view.name == "camera_5"] == 5 * [1600 * (900 - 92)]


def edit(folder, change):
    file = folder / "instances" / "instances_info.json"
    content = json.loads(file.read_text())
    change(content)
    file.write_text(json.dumps(content))


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda content: content["0"].pop("class_name"), r"'0\.class_name' is missing"),
        (lambda content: content["0"].pop("frame_annotations"), r"frame_annotations' is missing"),
        (lambda content: content["0"]["frame_annotations"]["frame_idx"].pop(), "no lists of one length"),
        (lambda content: content["0"]["frame_annotations"]["frame_idx"].__setitem__(0, -1), "frame_idx is '-1'"),
        (lambda content: content["0"]["frame_annotations"]["box_size"].__setitem__(0, [1, 0, 2]), "has the size"),
        (lambda content: content["0"]["frame_annotations"]["box_size"].__setitem__(0, [1, 2]), "expected 3 numbers"),
        (
            lambda content: content["0"]["frame_annotations"]["obj_to_world"].__setitem__(0, [[0] * 4] * 4),
            "no rotation",
        ),
    ],
)
def test_damaged_boxes_are_named(folder, change, problem):
    edit(folder, change)
    with pytest.raises(DataError, match=problem):
        load_clip(str(folder), WHOLE)


def test_damaged_numbers_are_named(folder):
    whole = (folder / "intrinsics" / "0.txt").read_text()
    for text, problem in ((whole[:9], "expected 9"), (whole.replace("40.0", "nan"), "not finite"), ("x", "no list")):
        (folder / "intrinsics" / "0.txt").write_text(text)
        with pytest.raises(DataError, match=problem):
            load_clip(str(folder), WHOLE)
    (folder / "intrinsics" / "0.txt").write_text(whole)
    sweep = folder / "lidar" / "000.bin"
    sweep.write_bytes(sweep.read_bytes()[:-3])
    with pytest.raises(DataError, match="no whole rows of 5"):
        load_clip(str(folder), WHOLE).sweeps[0].load()
    (folder / "extrinsics" / "001_0.txt").unlink()
    with pytest.raises(DataError, match=r"001_0\.txt: is missing"):
        load_clip(str(folder), WHOLE)
