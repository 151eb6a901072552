"""Paths through keys: every key is met, and nothing jumps between them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from instdrive_core.filming.camera_path import CameraKey, CameraPath
from instdrive_core.scene.camera import Camera, look_at

PLACES = ((0.0, 0.0, 2.0), (4.0, 0.0, 2.0), (6.0, 3.0, 3.0), (6.0, 9.0, 3.0))
TARGET = np.array([3.0, 20.0, 1.0])


def make_key(at, place, focal=500.0, size=(800, 600)):
    width, height = size
    pose = look_at(np.array(place), TARGET)
    return CameraKey(at, 10 * at, Camera(focal, focal, width / 2 + 8, height / 2, width, height, pose))


@pytest.fixture
def keys():
    return tuple(make_key(at, place) for at, place in zip((0.0, 1.0, 3.0, 3.5), PLACES, strict=True))


def test_every_key_is_met(keys):
    path = CameraPath(keys)
    for key in keys:
        found = path.find_camera(key.at, 800, 600)
        assert np.allclose(found.world_from_camera, key.camera.world_from_camera, atol=1e-9)
        assert np.allclose(found.intrinsics, key.camera.intrinsics)
        assert path.find_drive_time(key.at) == pytest.approx(key.time)
    assert np.allclose(path.find_camera(99.0, 800, 600).position, PLACES[-1]), "the camera stays where the path ends"


def test_speeds_and_turns_do_not_jump(keys):
    path = CameraPath(keys)
    step = 1e-3
    cameras = [path.find_camera(at, 80, 60) for at in np.arange(0.0, 3.5, step)]
    speed = np.diff([camera.position for camera in cameras], axis=0) / step
    turns = Rotation.from_matrix([camera.world_from_camera[:3, :3] for camera in cameras])
    turning = (turns[1:] * turns[:-1].inv()).as_rotvec() / step
    assert np.abs(np.diff(speed, axis=0)).max() < 0.1
    assert np.abs(np.diff(turning, axis=0)).max() < 0.1
    corner = np.diff([key.camera.position for key in keys], axis=0) / np.diff([key.at for key in keys])[:, None]
    assert np.abs(np.diff(corner, axis=0)).max() > 1, "straight lines would jump"


def test_a_camera_that_stands_between_two_keys_does_not_sway():
    still = [make_key(at, PLACES[0]) for at in (0.0, 1.0, 2.0)]
    path = CameraPath([*still, make_key(3.0, PLACES[1])])
    places = [path.find_camera(at, 80, 60).position for at in np.linspace(0.0, 1.9, 40)]
    assert np.abs(np.array(places) - PLACES[0]).max() < 0.05


def test_the_whole_film_of_a_key_is_in_a_picture_of_any_shape(keys):
    found = CameraPath(keys[:1]).find_camera(0.0, 400, 600)
    assert (found.width, found.height) == (400, 600)
    assert found.fx == pytest.approx(250.0)
    assert (found.cx, found.cy) == pytest.approx((204.0, 300.0))


def test_keys_must_come_one_after_the_other(keys):
    with pytest.raises(ValueError, match="rising"):
        CameraPath(keys[::-1])
    with pytest.raises(ValueError, match="at least one"):
        CameraPath(())


def test_a_path_goes_along_with_its_scene(keys):
    turn = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    moved = CameraPath(keys).transform(np.column_stack([2 * turn, [1.0, 0.0, 0.0]]))
    assert np.allclose(moved[1].camera.position, (1.0, 8.0, 4.0))
    assert np.allclose(moved[1].camera.world_from_camera[:3, 2], turn @ keys[1].camera.world_from_camera[:3, 2])
