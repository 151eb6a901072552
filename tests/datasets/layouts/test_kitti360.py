"""KITTI-360: sparse poses, standing and moving boxes, and damaged files."""

import numpy as np
import pytest
from small_clip import WHOLE, write_layout

from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import DataError


@pytest.fixture
def drive(tmp_path):
    return write_layout("KITTI-360", tmp_path / "clip")


def find(drive, name):
    return next(drive.parents[1].rglob(name))


def damage(file, old, new):
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))


def test_photos_without_a_pose_are_left_out_and_counted(drive):
    file = find(drive, "poses.txt")
    file.write_text("".join(line for line in file.read_text().splitlines(True) if line[0] not in "12"))
    clip = load_clip(str(drive), WHOLE)
    assert [frame.view.index for frame in clip.frames] == [0, 3, 4]
    assert "2 photos without a pose are left out" in clip.notes


def test_the_turn_of_rectification_is_taken_away_from_the_camera(drive):
    first = load_clip(str(drive), WHOLE).frames[0].view.camera
    angle = 0.1
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    damage(find(drive, "perspective.txt"), "1 0 0 0 1 0 0 0 1", " ".join(map(repr, turn.ravel().tolist())))
    second = load_clip(str(drive), WHOLE).frames[0].view.camera
    turned = second.world_from_camera[:3, :3] @ turn
    np.testing.assert_allclose(turned, first.world_from_camera[:3, :3], atol=1e-9)


def test_a_standing_object_has_one_box_from_its_first_to_its_last_frame(drive):
    file = find(drive, "*.xml")
    text = file.read_text()
    end = text.index("</object1>") + len("</object1>\n")
    standing = text[:end].replace("<timestamp>0<", "<timestamp>-1<").replace("<end_frame>0<", "<end_frame>3<")
    file.write_text(standing + "</opencv_storage>\n")
    clip = load_clip(str(drive), WHOLE)
    (track,) = clip.tracks
    assert not track.moving
    np.testing.assert_allclose(track.times, [0, 0.3], atol=1e-6)
    np.testing.assert_array_equal(track.world_from_box[0], track.world_from_box[1])


def test_ground_and_buildings_are_no_objects(drive):
    file = find(drive, "*.xml")
    file.write_text(file.read_text().replace("<label>car<", "<label>building<"))
    assert not load_clip(str(drive), WHOLE).tracks


@pytest.mark.parametrize(
    ("name", "old", "new", "problem"),
    [
        ("poses.txt", "0 ", "0.5 ", "is no step and 3×4 numbers"),
        ("calib_cam_to_pose.txt", "image_00", "image_07", "'image_00' is missing"),
        ("calib_cam_to_velo.txt", "0.8", "", "holds 11 numbers"),
        ("perspective.txt", "P_rect_00", "P_rect_07", "'P_rect_00' is missing"),
        ("*.xml", "<rows>4<", "<rows>3<", "has 16 numbers, expected 3×4"),
        ("*.xml", "<semanticId>26<", "<semanticId>x<", "no list of numbers"),
        ("*.xml", "</transform>", "", "no readable XML"),
    ],
)
def test_damaged_files_are_named(drive, name, old, new, problem):
    damage(find(drive, name), old, new)
    with pytest.raises(DataError, match=problem):
        load_clip(str(drive), WHOLE)
