"""KITTI's conventions, by the formulas of its devkits, and damaged files."""

import numpy as np
import pytest
from small_clip import WHOLE, write_layout

from instdrive_core.datasets.kitti.numbers import format_time, pose_from_oxts, read_named_numbers, read_times
from instdrive_core.datasets.kitti.tracking import place_camera_box
from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import DataError
from instdrive_core.files.xml_file import parse_xml


@pytest.fixture
def raw(tmp_path):
    return write_layout("KITTI raw", tmp_path / "clip")


@pytest.fixture
def tracking(tmp_path):
    return write_layout("KITTI tracking", tmp_path / "clip")


def test_the_gps_is_projected_as_in_the_devkit(tmp_path):
    latitude, longitude, roll, pitch, yaw = 49.015, 8.434, 0.035, -0.012, 2.1
    scale = np.cos(49.0 * np.pi / 180)
    pose = pose_from_oxts(tmp_path, np.array([latitude, longitude, 116.4, roll, pitch, yaw]), scale)
    east = scale * longitude * np.pi * 6378137 / 180
    north = scale * 6378137 * np.log(np.tan((90 + latitude) * np.pi / 360))
    np.testing.assert_allclose(pose[:3, 3], [east, north, 116.4])
    cosine, sine = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    about_x = np.array([[1, 0, 0], [0, cosine[0], -sine[0]], [0, sine[0], cosine[0]]])
    about_y = np.array([[cosine[1], 0, sine[1]], [0, 1, 0], [-sine[1], 0, cosine[1]]])
    about_z = np.array([[cosine[2], -sine[2], 0], [sine[2], cosine[2], 0], [0, 0, 1]])
    np.testing.assert_allclose(pose[:3, :3], about_z @ about_y @ about_x, atol=1e-12)


def test_labels_are_boxes_as_the_devkit_draws_them():
    length, width, height, turn, place = 4.2, 1.8, 1.5, 0.7, np.array([2.0, 1.6, 14.0])
    x = np.array([1, 1, -1, -1]) * length / 2
    z = np.array([1, -1, -1, 1]) * width / 2
    cosine, sine = np.cos(turn), np.sin(turn)
    bottom = np.stack([cosine * x + sine * z, np.zeros(4), -sine * x + cosine * z], axis=1) + place
    pose = place_camera_box(place, turn, height)
    local = np.stack([[-w, y, -height / 2] for w, y in zip(z, x, strict=True)])
    np.testing.assert_allclose(local @ pose[:3, :3].T + pose[:3, 3], bottom, atol=1e-12)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)


def test_calibrations_read_with_and_without_colons(tmp_path):
    file = tmp_path / "calib.txt"
    file.write_text("calib_time: 09-Jan-2012 13:57:47\nP2: 7.215377e+02 0 6.095593e+02\nR_rect 1 0 0\n\n")
    found = read_named_numbers(file)
    assert set(found) == {"P2", "R_rect"}
    np.testing.assert_array_equal(found["P2"], [721.5377, 0, 609.5593])


def test_times_keep_their_nanoseconds(tmp_path):
    file = tmp_path / "timestamps.txt"
    file.write_text("2011-09-26 13:02:25.594360375\n2011-09-26 13:02:25.697\n")
    first, second = read_times(file)
    assert second - first == pytest.approx(0.102639625, abs=1e-6)
    assert format_time(1317042145.5) == "2011-09-26 13:02:25.500000000"
    file.write_text("yesterday\n")
    with pytest.raises(DataError, match="line 1 is no time"):
        read_times(file)


def test_a_bomb_of_entities_is_refused(tmp_path):
    file = tmp_path / "tracklet_labels.xml"
    file.write_text('<!DOCTYPE x [<!ENTITY a "aaaa">]><x>&a;</x>')
    with pytest.raises(DataError, match="defines entities"):
        parse_xml(file)


def damage(file, old, new):
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))


@pytest.mark.parametrize(
    ("name", "old", "new", "problem"),
    [
        ("../calib_cam_to_cam.txt", "P_rect_02", "P_rect_09", "'P_rect_02' is missing"),
        ("../calib_cam_to_cam.txt", "R_rect_00: 1.0", "R_rect_00: 2.0", "'R_rect_00' is no rotation"),
        ("../calib_velo_to_cam.txt", "T: ", "T: 1.0 ", "has 4 numbers, expected 3×1"),
        ("oxts/data/0000000001.txt", "49", "149", "no place on Earth"),
        ("oxts/timestamps.txt", "1970", "1980", "do not rise"),
        ("tracklet_labels.xml", "<count>2", "<count>3", "promises 3 tracklets and holds 2"),
        ("tracklet_labels.xml", "<h>1.5", "<h>-1.5", "has the size"),
        ("tracklet_labels.xml", "<tx>", "<tx>x", "no list of numbers"),
        ("tracklet_labels.xml", 'encoding="UTF-8"', 'encoding="TTF-8"', "no readable XML"),
        ("tracklet_labels.xml", "<objectType>Car</objectType>", "", "objectType' is missing"),
    ],
)
def test_damaged_files_of_a_raw_drive_are_named(raw, name, old, new, problem):
    damage(raw / name, old, new)
    with pytest.raises(DataError, match=problem):
        load_clip(str(raw), WHOLE)


@pytest.mark.parametrize(
    ("name", "old", "new", "problem"),
    [
        ("calib/0000.txt", "Tr_velo_cam", "Tr_none", "'Tr_velo_cam' is missing"),
        ("oxts/0000.txt", " 0.0\n", " nan\n", "not finite"),
        ("label_02/0000.txt", "0 0 Car", "99 0 Car", "no pose of step 99"),
        ("label_02/0000.txt", " 1.5 ", " ", "has 16 fields"),
    ],
)
def test_damaged_files_of_a_sequence_are_named(tracking, name, old, new, problem):
    damage(tracking.parents[1] / name, old, new)
    with pytest.raises(DataError, match=problem):
        load_clip(str(tracking), WHOLE)


def test_boxes_nobody_cares_for_are_left_out(tracking):
    file = tracking.parents[1] / "label_02" / "0000.txt"
    file.write_text("0 -1 DontCare -1 -1 -10 1 1 2 2 -1000 -1000 -1000 -10 -1 -1 -1\n" + file.read_text())
    assert [track.label for track in load_clip(str(tracking), WHOLE).tracks] == ["Car", "Car"]
