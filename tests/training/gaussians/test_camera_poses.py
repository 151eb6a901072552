"""Camera poses learned beside the scene: gradients, and calibrations that training finds back."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from tiny_training import new_trainer, tiny_config

from instdrive_core.scene.camera import Camera, CameraView
from instdrive_core.training.backends import torch_ops
from instdrive_core.training.backends.cpu_backend import CpuBackend
from instdrive_core.training.gaussians.camera_poses import CameraPoses, find_correction, move_camera
from instdrive_core.training.settings.config import GeometryConfig
from instdrive_core.training.views.view_store import ViewFacts

WRONG = np.array([0.03, -0.02, 0.02, 0.004, 0.006, -0.005])


def some_camera(x=0.0):
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec([0.3, -0.5, 0.2]).as_matrix()
    pose[:3, 3] = [x, 2, -1]
    return Camera(40, 40, 20, 15, 40, 30, pose)


def facts(*keys):
    return [ViewFacts(key, some_camera(number), 0.1 * int(key[-2:]), False) for number, key in enumerate(keys)]


@pytest.mark.parametrize("sum_gradient", [CpuBackend.sum_rigid_gradient, torch_ops.sum_rigid_gradient])
def test_gradient_along_a_rigid_motion_is_that_of_differences(sum_gradient):
    rng = np.random.default_rng(0)
    means, quats = rng.normal(0, 3, (3000, 3)), rng.normal(size=(3000, 4))
    by_means, by_quats = rng.normal(size=(3000, 3)), rng.normal(size=(3000, 4))

    def measure(shift, turn):
        rotation = Rotation.from_rotvec(turn)
        turned = rotation * Rotation.from_quat(quats[:, [1, 2, 3, 0]])
        w_last = turned.as_quat() * np.linalg.norm(quats, axis=1)[:, None]
        w_first = w_last[:, [3, 0, 1, 2]]
        w_first *= np.sign((w_first * quats).sum(axis=1))[:, None]
        return (by_means * (rotation.apply(means) + shift)).sum() + (by_quats * w_first).sum()

    tensors = [torch.tensor(array, dtype=torch.float32) for array in (means, quats, by_means, by_quats)]
    force, torque = sum_gradient(*tensors)
    steps = 1e-4 * np.eye(3)
    zero = np.zeros(3)
    expected = [(measure(step, zero) - measure(-step, zero)) / 2e-4 for step in steps]
    np.testing.assert_allclose(force, expected, rtol=1e-3, atol=0.05)
    expected = [(measure(zero, step) - measure(zero, -step)) / 2e-4 for step in steps]
    np.testing.assert_allclose(torque, expected, rtol=1e-3, atol=0.05)


def test_a_correction_is_found_back_at_any_resolution():
    camera = some_camera()
    moved = move_camera(camera, WRONG)
    np.testing.assert_allclose(find_correction(camera, moved), WRONG, atol=1e-9)
    half = move_camera(camera.resize(20, 15), WRONG)
    assert half.width == 20
    np.testing.assert_allclose(half.world_from_camera, moved.world_from_camera)
    assert move_camera(camera, np.zeros(6)) is camera


def test_training_finds_a_camera_that_is_mounted_elsewhere_than_calibrated():
    config = tiny_config()
    geometry = replace(
        config.geometry, iterations=150, coarse_iterations=0, means_lr=0.0, scale_lr=0.0, rotation_lr=0.0
    )
    trainer, _ = new_trainer(replace(config, geometry=replace(geometry, rig_lr=2e-3)))
    true = [photo.camera for photo in trainer.store.facts]
    store = trainer.store
    store.place_cameras([move_camera(camera, -WRONG).world_from_camera for camera in true])

    def measure_misfit():
        drawn = [trainer.cameras.correct(number, store.get(number).camera) for number in range(len(store))]
        return np.abs([find_correction(*pair)[3:] for pair in zip(true, drawn, strict=True)]).mean()

    before = measure_misfit()
    while trainer.iteration < geometry.iterations:
        trainer.rgb_step()
        trainer.iteration += 1
    assert before > 4e-3
    assert measure_misfit() < 0.4 * before


def test_poses_stay_where_rates_are_zero():
    poses = CameraPoses(facts("front/00"), GeometryConfig(rig_lr=0.0, photo_lr=0.0))
    assert not poses.are_learned
    poses.step(0, some_camera(), np.ones(3), np.ones(3), 0.5)
    assert poses.correct(0, some_camera()).world_from_camera.tolist() == some_camera().world_from_camera.tolist()


def test_all_photos_of_a_camera_share_a_correction_and_their_own_is_pulled_back():
    photos = facts("front/00", "front/01", "left/00")
    poses = CameraPoses(photos, GeometryConfig(rig_lr=1e-3, photo_lr=0.0))
    poses.step(0, photos[0].camera, np.array([1.0, 0, 0]), np.zeros(3), 0.0)
    moves = [find_correction(photo.camera, poses.correct(n, photo.camera)) for n, photo in enumerate(photos)]
    assert np.abs(moves[0]).max() > 1e-4
    np.testing.assert_allclose(moves[0], moves[1], atol=1e-9)
    assert not moves[2].any()
    alone = CameraPoses(photos, GeometryConfig(rig_lr=0.0, photo_lr=1e-3, photo_decay=0.5))
    alone.start_from([CameraView(move_camera(photos[0].camera, WRONG), "front", 0, 0.0)])
    moves = [find_correction(photo.camera, alone.correct(n, photo.camera)) for n, photo in enumerate(photos)]
    np.testing.assert_allclose(moves[0], WRONG, atol=1e-6)
    np.testing.assert_allclose(moves[1], WRONG, atol=1e-6, err_msg="the camera's own share holds for all its photos")


def test_views_between_two_photos_get_what_lies_between_and_other_cameras_nothing():
    photos = facts("front/00", "front/02")
    poses = CameraPoses(photos, GeometryConfig())
    poses.start_from([CameraView(move_camera(photos[0].camera, 2 * WRONG), "front", 0, 0.0)])
    poses.start_from(
        [
            CameraView(move_camera(photos[0].camera, 2 * WRONG), "front", 0, 0.0),
            CameraView(photos[1].camera, "front", 2, 0.2),
        ]
    )
    held_out = CameraView(some_camera(5), "front", 1, 0.1, held_out=True)
    other = CameraView(some_camera(6), "back", 1, 0.1)
    corrected = poses.correct_views([held_out, other])
    np.testing.assert_allclose(find_correction(held_out.camera, corrected[0].camera), WRONG, atol=1e-6)
    assert corrected[0].held_out
    assert corrected[1].camera is other.camera


def test_a_resumed_run_goes_on_with_the_same_poses():
    photos = facts("front/00", "front/01")
    one, other = CameraPoses(photos, GeometryConfig()), CameraPoses(photos, GeometryConfig())
    for number in (0, 1, 0):
        one.step(number, photos[number].camera, np.array([1.0, -2, 3]), np.array([0.5, 1, -1]), 0.1)
    other.load_state_tensors({name: value.clone() for name, value in one.state_tensors().items()})
    for poses in (one, other):
        poses.step(1, photos[1].camera, np.array([0.3, 1, 0]), np.array([0.5, 0, -1]), 0.2)
    np.testing.assert_array_equal(one.list_poses(), other.list_poses())
