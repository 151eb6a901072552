"""nuScenes and T4: scenes by name, sweeps between key frames, boxes between them, and damaged tables."""

import json
import shutil

import numpy as np
import pytest
from small_clip import WHOLE, write_layout

from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import DataError, UntrustedDataError
from instdrive_core.maths.rotations import matrix_from_quaternion


@pytest.fixture
def root(tmp_path):
    return write_layout("nuScenes", tmp_path / "clip")


@pytest.fixture
def t4(tmp_path):
    return write_layout("T4", tmp_path / "clip")


def edit(folder, name, change):
    file = folder / f"{name}.json"
    content = json.loads(file.read_text())
    result = change(content)
    file.write_text(json.dumps(content if result is None else result))


def tables(root):
    return root / "v1.0-mini"


def test_a_scene_is_opened_by_its_name(root):
    name = json.loads((tables(root) / "scene.json").read_text())[0]["name"]
    assert len(load_clip(str(root / name), WHOLE).frames) == 10
    with pytest.raises(DataError, match=r"has no scene 'scene-9'.*There are"):
        load_clip(str(root / "scene-9"), WHOLE)
    edit(tables(root), "scene", lambda rows: [*rows, rows[0] | {"token": "x", "name": "other"}])
    with pytest.raises(DataError, match="holds several scenes"):
        load_clip(str(root), WHOLE)
    assert load_clip(str(root / name), WHOLE).name == name


def test_what_lies_between_key_frames_is_used_and_boxes_are_interpolated(root):
    """Key frames are every second step: photos and sweeps between them stay, boxes only of key frames."""
    whole = load_clip(str(root), WHOLE)
    samples = json.loads((tables(root) / "sample.json").read_text())
    kept = {row["token"] for row in samples[::2]}
    nearest = {row["token"]: samples[min(place // 2 * 2, 4)]["token"] for place, row in enumerate(samples)}

    def thin(rows):
        for row in rows:
            row["is_key_frame"] = row["sample_token"] in kept
            row["sample_token"] = nearest[row["sample_token"]]

    edit(tables(root), "sample", lambda rows: rows[::2])
    edit(tables(root), "sample_data", thin)
    edit(tables(root), "sample_annotation", lambda rows: [row for row in rows if row["sample_token"] in kept])
    part = load_clip(str(root), WHOLE)
    assert len(part.frames) == len(whole.frames)
    assert len(part.sweeps) == len(whole.sweeps)
    moving = [next(track for track in clip.tracks if track.moving) for clip in (whole, part)]
    assert [len(track.times) for track in moving] == [5, 3]
    for frame in part.frames:
        poses = [track.interpolate_pose(frame.view.time) for track in moving]
        np.testing.assert_allclose(poses[0], poses[1], atol=1e-4)


def test_sensors_are_matched_after_their_offsets_in_key_frames(root):
    """Photos of the front camera come 30 ms before the sweep of their step, as on a turning LiDAR's car."""

    def shift(rows):
        for row in rows:
            if "CAM_FRONT/" in row["filename"]:
                row["timestamp"] -= 30_000

    edit(tables(root), "sample_data", shift)
    clip = load_clip(str(root), WHOLE)
    assert len(clip.sweeps) == 3
    assert {frame.view.index for frame in clip.frames} == {0, 1, 2, 3, 4}
    moving = next(track for track in clip.tracks if track.moving)
    np.testing.assert_allclose(moving.times, [frame.view.time for frame in clip.frames[::2]], atol=1e-6)


def test_missing_files_are_counted(root):
    shutil.rmtree(root / "samples" / "LIDAR_TOP")
    clip = load_clip(str(root), WHOLE)
    assert not clip.sweeps
    assert "3 files that the tables name are missing" in clip.notes
    shutil.rmtree(root / "samples")
    with pytest.raises(DataError, match="holds no photo of the scene"):
        load_clip(str(root), WHOLE)


def test_there_is_a_map_and_boxes_tell_their_points(root):
    """What nuscenes-devkit needs: `benchmarks.devkits` lets that open a recording."""

    def read(name):
        return json.loads((tables(root) / f"{name}.json").read_text())

    (blank,), (log,) = read("map"), read("log")
    assert blank["log_tokens"] == [log["token"]]
    assert (root / blank["filename"]).is_file()
    cars = {row["token"]: row for row in read("ego_pose")}
    sweeps = {row["sample_token"]: row for row in read("sample_data") if row["filename"].endswith(".bin")}
    rows = read("sample_annotation")
    assert sum(row["num_lidar_pts"] for row in rows) > 0
    for row in rows:
        sweep = sweeps.get(row["sample_token"])
        points = np.zeros((0, 3))
        if sweep is not None:
            car = cars[sweep["ego_pose_token"]]
            points = np.fromfile(root / sweep["filename"], "<f4").reshape(-1, 5)[:, :3]
            points = points @ matrix_from_quaternion(np.array(car["rotation"])).T + car["translation"]
        local = (points - row["translation"]) @ matrix_from_quaternion(np.array(row["rotation"]))
        half = np.array(row["size"])[[1, 0, 2]] / 2  # length is along x
        sure, near = ((np.abs(local) <= half + slack).all(axis=1).sum() for slack in (-0.01, 0.01))
        assert sure <= row["num_lidar_pts"] <= near


def test_lens_distortion_of_t4_is_in_the_order_of_opencv(t4):
    def bend(rows):
        rows[0]["camera_distortion"] = [0.1, 0.02, 0.003, 0.004, 0.005, 0.6, 0.07, 0.008]

    edit(t4 / "annotation", "calibrated_sensor", bend)
    frames = load_clip(str(t4), WHOLE).frames
    assert frames[0].valid is not None
    assert frames[1].valid is None
    edit(t4 / "annotation", "calibrated_sensor", lambda rows: rows[0].update(camera_distortion=[0.1, 0.2]))
    with pytest.raises(DataError, match="has 2 coefficients"):
        load_clip(str(t4), WHOLE)


def test_points_of_t4_may_have_more_columns(t4):
    whole = load_clip(str(t4), WHOLE).sweeps[0].load()
    for file in (t4 / "data" / "LIDAR_TOP").iterdir():
        rows = np.fromfile(file, np.float32).reshape(-1, 5)
        np.column_stack([rows, np.zeros((len(rows), 2))]).astype(np.float32).tofile(file)
    (t4 / "data" / "info.json").write_text('{"num_pts_feats": 7}')

    def name_info(rows):
        for row in rows:
            if "LIDAR" in row["filename"]:
                row["info_filename"] = "data/info.json"

    edit(t4 / "annotation", "sample_data", name_info)
    np.testing.assert_array_equal(load_clip(str(t4), WHOLE).sweeps[0].load().points, whole.points)
    (t4 / "data" / "info.json").write_text('{"num_pts_feats": 700}')
    with pytest.raises(DataError, match="'num_pts_feats' is 700"):
        load_clip(str(t4), WHOLE)


@pytest.mark.parametrize(
    ("name", "change", "problem"),
    [
        ("sample_data", lambda rows: {"rows": rows}, "expected a list of objects"),
        ("sample_data", lambda rows: rows[0].update(timestamp="now"), "'timestamp' is 'now'"),
        (
            "sample_data",
            lambda rows: rows[0].update(ego_pose_token="?"),
            r"ego_pose\.json: has no row with the token '\?'",
        ),
        ("sample_data", lambda rows: rows[0].pop("calibrated_sensor_token"), "calibrated_sensor_token' is missing"),
        ("ego_pose", lambda rows: rows[0].update(rotation=[0, 0, 0, 0]), "is no rotation and position"),
        ("ego_pose", lambda rows: rows[0].update(translation=[1, "2", 3]), "expected numbers"),
        ("calibrated_sensor", lambda rows: rows[0].update(camera_intrinsic=[[1]]), "no matrix of 3×3"),
        ("sample_annotation", lambda rows: rows[0].update(size=[1, 2]), "has 2 numbers, expected width"),
        ("sample_annotation", lambda rows: rows[0].update(size=[1, 2, -3]), "has the size"),
        ("sample_annotation", lambda rows: rows[0].update(instance_token="?"), r"instance\.json: has no row"),
        ("sensor", lambda rows: rows[0].update(channel=3), "'channel' is '3', expected a text"),
    ],
)
def test_damaged_tables_are_named(root, name, change, problem):
    edit(
        tables(root), name, lambda rows: found if isinstance(found := change(rows), dict) and "rows" in found else None
    )
    with pytest.raises(DataError, match=problem):
        load_clip(str(root), WHOLE)


def test_file_names_may_not_lead_out(root):
    edit(tables(root), "sample_data", lambda rows: rows[0].update(filename="../../etc/passwd"))
    with pytest.raises(UntrustedDataError, match="leads out of"):
        load_clip(str(root), WHOLE)
