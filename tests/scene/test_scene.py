import numpy as np
import pytest
from random_scene import random_scene

from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.scene.scene import extract_node_rotations, place_in_world, scene_from_gaussians


def test_pose_palette_names_background_first_and_who_is_present():
    scene = random_scene(actors=2)
    poses, present = scene.find_node_poses(0.1)
    np.testing.assert_array_equal(poses[0], np.eye(4))
    np.testing.assert_allclose(poses[1], scene.actors[0].interpolate_pose(0.1))
    assert present.tolist() == [1, 1, 0]


def test_placing_moves_actors_and_leaves_the_background_alone():
    scene = random_scene(actors=2)
    gaussians, (poses, _) = scene.gaussians, scene.find_node_poses(0.3)
    means, quats = place_in_world(gaussians.means, gaussians.quats, scene.nodes, poses)
    still = scene.nodes == 0
    assert means[still].tobytes() == gaussians.means[still].tobytes()
    for row in np.flatnonzero(~still)[::7]:
        pose = poses[scene.nodes[row]]
        np.testing.assert_allclose(means[row], pose[:3, :3] @ gaussians.means[row] + pose[:3, 3], rtol=1e-4, atol=1e-4)
        turned = pose[:3, :3] @ matrix_from_quaternion(gaussians.quats[row].astype(float))
        np.testing.assert_allclose(matrix_from_quaternion(quats[row].astype(float)), turned, atol=1e-5)


def test_a_static_scene_is_not_copied_by_placing():
    scene = scene_from_gaussians(random_scene().gaussians)
    poses, _ = scene.find_node_poses(0.0)
    means, quats = place_in_world(scene.gaussians.means, scene.gaussians.quats, scene.nodes, poses)
    assert means is scene.gaussians.means
    assert quats is scene.gaussians.quats


def test_rotations_are_orthonormal_again():
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[1, :3, :3] *= 1 + 1e-4
    np.testing.assert_allclose(extract_node_rotations(poses)[1], np.eye(3), atol=1e-12)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("instance_ids", np.zeros(3, np.uint32)),
        ("nodes", np.full(200, 3, np.uint16)),
        ("extra", {"weight": np.zeros(7)}),
    ],
)
def test_parts_that_do_not_fit_are_refused(field, value):
    scene = random_scene()
    setattr(scene, field, value)
    with pytest.raises(ValueError, match="weight" if field == "extra" else field):
        scene.__post_init__()
