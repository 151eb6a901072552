"""Waymo's tables: range images by the formulas of its package, and damaged tables."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from small_clip import WHOLE, write_layout

from instdrive_core.datasets.registry import load_clip
from instdrive_core.datasets.waymo.columns import BEAMS, BOX, CAR_POSE, IMAGE, PIXEL_POSES, RETURNS, TIME
from instdrive_core.datasets.waymo.range_images import (
    build_turns,
    compute_beam_inclinations,
    compute_pixel_directions,
    list_turn_angles,
)
from instdrive_core.errors import DataError


@pytest.fixture
def segment(tmp_path):
    return write_layout("Waymo", tmp_path / "clip")


def rewrite(segment, component, edit):
    """Write a table again after `edit` has changed its columns, which are lists."""
    file = segment.parent / component / f"{segment.name}.parquet"
    columns = pq.read_table(file).to_pydict()
    edit(columns)
    pq.write_table(pa.table(columns), str(file))


def test_the_middle_of_a_range_image_looks_ahead_and_its_left_half_to_the_left():
    rays = compute_pixel_directions(np.array([-0.3, 0.1]), 1000, np.eye(4))
    np.testing.assert_allclose(rays[0, 500], [np.cos(0.1), 0, np.sin(0.1)], atol=0.01)
    np.testing.assert_allclose(rays[1, 250], [0, np.cos(-0.3), np.sin(-0.3)], atol=0.01)
    turned = np.eye(4)
    turned[:2, :2] = [[0, -1], [1, 0]]
    turned_rays = compute_pixel_directions(np.array([0.0]), 1000, turned)
    np.testing.assert_allclose(turned_rays @ turned[:3, :3].T, compute_pixel_directions(np.zeros(1), 1000, np.eye(4)))


def test_even_beams_lie_in_the_middle_of_their_shares():
    np.testing.assert_allclose(compute_beam_inclinations(-0.4, 0.4, 4), [-0.3, -0.1, 0.1, 0.3])


def test_turns_are_about_x_then_y_then_z():
    roll, pitch, yaw = angles = np.array([0.1, -0.2, 2.5])
    x = np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]])
    y = np.array([[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]])
    z = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    np.testing.assert_allclose(build_turns(angles[None])[0], z @ y @ x, atol=1e-12)
    np.testing.assert_allclose(list_turn_angles(z @ y @ x), angles, atol=1e-12)


def test_without_poses_of_pixels_the_car_stands_still_while_the_lidar_turns(segment):
    first = load_clip(str(segment), WHOLE).sweeps[0].load()
    (segment.parent / "lidar_pose" / f"{segment.name}.parquet").unlink()
    second = load_clip(str(segment), WHOLE).sweeps[0].load()
    assert len(first.points) == len(second.points)
    assert np.abs(first.points - second.points).max() > 0.01


def test_both_returns_are_points(segment):
    count = len(load_clip(str(segment), WHOLE).sweeps[0].load().points)

    def double(columns):
        for part in ("values", "shape"):
            columns[f"{RETURNS[1]}.{part}"] = columns[f"{RETURNS[0]}.{part}"]

    rewrite(segment, "lidar", double)
    assert len(load_clip(str(segment), WHOLE).sweeps[0].load().points) == 2 * count


def test_a_folder_with_one_segment_needs_no_name(segment):
    assert len(load_clip(str(segment.parent), WHOLE).frames) == 10


def test_missing_components_are_missing_parts(segment):
    for component in ("lidar", "lidar_box"):
        (segment.parent / component / f"{segment.name}.parquet").unlink()
    clip = load_clip(str(segment), WHOLE)
    assert not clip.sweeps
    assert not clip.tracks


def load_everything(segment):
    clip = load_clip(str(segment), WHOLE)
    for part in (*clip.sweeps,):
        part.load()
    for frame in clip.frames:
        frame.load_image()


@pytest.mark.parametrize(
    ("component", "edit", "problem"),
    [
        ("vehicle_pose", lambda c: c.pop(CAR_POSE), "world_from_vehicle.transform' is missing"),
        ("vehicle_pose", lambda c: c[CAR_POSE].__setitem__(0, [1.0] * 16), "is no rotation and position"),
        ("vehicle_pose", lambda c: c[CAR_POSE].__setitem__(0, [1.0] * 3), "holds no 4×4 numbers"),
        ("camera_image", lambda c: c[IMAGE].__setitem__(0, None), "holds no photo"),
        ("camera_image", lambda c: c[IMAGE].__setitem__(0, b"no jpeg"), "no readable photo"),
        ("camera_image", lambda c: c[TIME].__setitem__(0, 3), "no pose at 3"),
        ("lidar", lambda c: c[f"{RETURNS[0]}.shape"].__setitem__(0, [9, 9, 4]), "numbers and the shape"),
        ("lidar", lambda c: c[f"{RETURNS[0]}.values"][0].__setitem__(0, float("nan")), "no number in row 0"),
        ("lidar_pose", lambda c: c[f"{PIXEL_POSES}.values"][0].__setitem__(3, 1e38), "a point lies at|not fit"),
        ("lidar_calibration", lambda c: c[BEAMS].__setitem__(0, [0.1]), "does not fit 1 beams"),
        ("lidar_box", lambda c: c[BOX[3]].__setitem__(0, -1.0), "row 0 has the size"),
    ],
)
def test_damaged_tables_are_named(segment, component, edit, problem):
    rewrite(segment, component, edit)
    with pytest.raises(DataError, match=problem):
        load_everything(segment)


def test_a_table_that_is_cut_off_is_refused(segment):
    file = segment.parent / "lidar" / f"{segment.name}.parquet"
    file.write_bytes(file.read_bytes()[:-9])
    with pytest.raises(DataError, match="no readable parquet table"):
        load_clip(str(segment), WHOLE)
