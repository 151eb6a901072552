"""Up and unit of worlds that nobody has levelled or measured."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from instdrive_core.datasets.upright import find_upright_world
from instdrive_core.scene.camera import look_at


def drive(length: float, count: int = 20) -> np.ndarray:
    """Poses along a straight street, level."""
    return np.stack(
        [look_at(np.array([x, 0.0, 1.5]), np.array([x + 5, 0.0, 1.5])) for x in np.linspace(0, length, count)]
    )


def test_any_turn_of_a_level_drive_is_set_upright():
    for seed in range(5):
        turn = np.eye(4)
        turn[:3, :3] = Rotation.random(random_state=seed).as_matrix()
        world = find_upright_world(turn @ drive(30), np.zeros((0, 3)))
        poses = world.transform_poses(turn @ drive(30))
        np.testing.assert_allclose(-poses[:, :3, 1], np.tile([0, 0, 1.0], (20, 1)), atol=1e-9)
        np.testing.assert_allclose(np.ptp(poses[:, 2, 3]), 0, atol=1e-9)


@pytest.mark.parametrize("length", [10, 100, 2000])
def test_metric_drives_of_any_length_keep_their_unit(length):
    rng = np.random.default_rng(0)
    points = np.stack(
        [rng.uniform(0, length, 500), rng.choice([-1, 1], 500) * rng.uniform(4, 30, 500), np.zeros(500)], 1
    )
    assert find_upright_world(drive(length, max(20, length // 10)), points).scale == 1
    assert find_upright_world(drive(length), np.zeros((0, 3))).scale == 1


def test_cameras_that_contradict_each_other_leave_z_up_and_say_so():
    poses = drive(30, 2)
    poses[1, :3, :2] *= -1
    world = find_upright_world(poses, np.zeros((0, 3)))
    np.testing.assert_array_equal(world.rotation, np.eye(3))
    assert "contradict" in world.notes[0]
