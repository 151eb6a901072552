"""Corrected tracks: the plain pose where nothing is corrected, true gradients, and perturbed tracks pulled back."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from random_scene import random_track
from scipy.spatial.transform import Rotation

from instdrive_core.scene.camera import PhotoLag
from instdrive_core.scene.track import Track
from instdrive_core.training.gaussians.actor_poses import ActorPoses, rotations_from_vectors

TIMES = (0.0, 0.13, 0.2, 0.37, 0.42)


@pytest.fixture
def tracks() -> tuple[Track, ...]:
    """Three tracks of five, four and one keys; the last two are absent some of the time."""
    rng = np.random.default_rng(0)
    return random_track(rng, "a"), random_track(rng, "b", start=0.2, steps=4), random_track(rng, "c", 0.4, 1)


def random_corrections(poses: ActorPoses, size: float = 0.2, seed: int = 1) -> dict[str, torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    zero = poses.initial_corrections()
    return {name: size * torch.randn(value.shape, generator=generator) for name, value in zero.items()}


@pytest.mark.parametrize("corrected", [False, True])
@pytest.mark.parametrize("time", TIMES)
def test_without_correction_the_poses_are_those_of_the_tracks(tracks, time, corrected):
    poses = ActorPoses(tracks)
    found = poses.at(time, poses.initial_corrections() if corrected else None)
    expected = [np.eye(4), *(track.interpolate_pose(time) if track.covers(time) else np.eye(4) for track in tracks)]
    np.testing.assert_array_equal(found.present, [True, *(track.covers(time) for track in tracks)])
    np.testing.assert_allclose(found.matrices, expected, atol=1e-12)
    np.testing.assert_allclose(found.rotations.numpy(), found.matrices[:, :3, :3], atol=1e-6)
    np.testing.assert_allclose(found.shifts.numpy(), found.matrices[:, :3, 3], atol=1e-6)
    assert found.rotations.dtype == found.shifts.dtype == torch.float32


def test_poses_and_corrections_are_those_of_the_moment_that_a_photo_shows(tracks):
    poses = ActorPoses(tracks)
    corrections, lag = random_corrections(poses), PhotoLag.look_from(np.array([0.5, 0, 0]), 0.3, -0.1, -0.1, -0.06)
    found = poses.at(0.3, corrections, lag)
    for node, track in enumerate(tracks, start=1):
        if len(track.times) > 1:
            shown = 0.3 + lag.find(track.interpolate_position(0.3))
            np.testing.assert_allclose(found.matrices[node], poses.at(shown, corrections).matrices[node], atol=1e-12)
            assert 1e-4 < abs(shown - 0.3) < 0.1
    assert not np.allclose(found.matrices, poses.at(0.3, corrections).matrices, atol=1e-4)


def test_exponential_is_a_rotation_by_the_vector():
    vectors = np.random.default_rng(0).normal(size=(50, 3)) * np.geomspace(1e-9, 2, 50)[:, None]
    found = rotations_from_vectors(torch.from_numpy(vectors)).numpy()
    np.testing.assert_allclose(found, Rotation.from_rotvec(vectors).as_matrix(), atol=1e-12)


def test_corrections_are_applied_in_the_box_frame(tracks):
    poses = ActorPoses(tracks)
    corrections = poses.initial_corrections()
    corrections["track_shifts"][2] = torch.tensor([0.0, 0.5, 0.0])
    corrections["track_turns"][2] = torch.tensor([0.0, 0.0, 0.1])
    base, found = tracks[0].interpolate_pose(0.2), poses.at(0.2, corrections).matrices[1]
    np.testing.assert_allclose(found[:3, 3], base[:3, 3] + 0.5 * base[:3, 1], atol=1e-7)
    np.testing.assert_allclose(found[:3, :3], base[:3, :3] @ Rotation.from_rotvec([0, 0, 0.1]).as_matrix(), atol=1e-7)
    quarter, base = poses.at(0.225, corrections).matrices[1], tracks[0].interpolate_pose(0.225)
    np.testing.assert_allclose(quarter[:3, 3], base[:3, 3] + 0.375 * base[:3, 1], atol=1e-7)


@pytest.mark.parametrize("size", [0.0, 0.2])
@pytest.mark.parametrize("time", [-0.04, 0.13, 0.42])
def test_gradient_is_that_of_finite_differences(tracks, time, size):
    poses, generator = ActorPoses(tracks), torch.Generator().manual_seed(2)
    corrections = {name: value.double() for name, value in random_corrections(poses, size).items()}
    weights = torch.randn(len(tracks) + 1, 3, 4, generator=generator, dtype=torch.float64)
    for value in corrections.values():
        value.requires_grad_(True)
    found = poses.at(time, corrections)
    (found.rotations * weights[..., :3]).sum().add((found.shifts * weights[..., 3]).sum()).backward()

    def loss(values: dict[str, torch.Tensor]) -> float:
        return float((poses.at(time, values).matrices[:, :3] * weights.numpy()).sum())

    for name in corrections:
        gradient = corrections[name].grad
        for entry in np.ndindex(tuple(gradient.shape)):
            sides = []
            for step in (1e-5, -1e-5):
                moved = {key: value.detach().clone() for key, value in corrections.items()}
                moved[name][entry] += step
                sides.append(loss(moved))
            assert float(gradient[entry]) == pytest.approx((sides[0] - sides[1]) / 2e-5, abs=1e-5), (name, entry)


def test_keys_far_from_the_time_and_absent_actors_get_no_gradient(tracks):
    poses = ActorPoses(tracks)
    corrections = {name: value.requires_grad_(True) for name, value in random_corrections(poses).items()}
    found = poses.at(0.13, corrections)
    np.testing.assert_array_equal(found.rotations[2:].detach(), np.tile(np.eye(3, dtype=np.float32), (2, 1, 1)))
    (found.rotations.sum() + found.shifts.sum()).backward()
    for value in corrections.values():
        assert value.grad[1:3].abs().min() > 0, "the keys at 0.1 and 0.2 s"
        assert not value.grad[[0, *range(3, 10)]].any()


def test_refined_tracks_are_the_corrected_poses(tracks):
    poses = ActorPoses(tracks)
    corrections = random_corrections(poses, 0.05)
    refined = poses.correct_tracks(corrections)
    assert [(track.id, track.label, track.moving) for track in refined] == [
        (track.id, track.label, track.moving) for track in tracks
    ]
    for node, track in enumerate(refined, start=1):
        for time in track.times:
            np.testing.assert_allclose(
                track.interpolate_pose(time), poses.at(time, corrections).matrices[node], atol=1e-6
            )
        for time in track.times[:-1] + 0.03:
            np.testing.assert_allclose(
                track.interpolate_pose(time), poses.at(time, corrections).matrices[node], atol=5e-3
            )
    plain = poses.correct_tracks(poses.initial_corrections())
    np.testing.assert_array_equal(plain[0].world_from_box, tracks[0].world_from_box)


def test_equal_corrections_of_a_track_only_move_the_gaussians_in_its_box(tracks):
    poses = ActorPoses(tracks)
    shift, turn = torch.tensor([0.1, -0.2, 0.05]), torch.tensor([0.02, -0.1, 0.3])
    corrections = {"track_shifts": shift.repeat(10, 1), "track_turns": turn.repeat(10, 1)}
    in_box = np.eye(4)
    in_box[:3, :3], in_box[:3, 3] = Rotation.from_rotvec(turn.double().numpy()).as_matrix(), shift.numpy()
    for time in TIMES:
        found = poses.at(time, corrections).matrices[1]
        np.testing.assert_allclose(found, poses.at(time).matrices[1] @ in_box, atol=1e-7)


def misplaced(track: Track, rng: np.random.Generator, metres: float, degrees: float) -> Track:
    """The track with every key moved by `metres` and turned by `degrees`, each in a direction of its own."""
    count = len(track.times)
    shifts, axes = rng.normal(size=(2, count, 3))
    shifts *= metres / np.linalg.norm(shifts, axis=1, keepdims=True)
    axes *= np.radians(degrees) / np.linalg.norm(axes, axis=1, keepdims=True)
    poses = track.world_from_box.copy()
    poses[:, :3, 3] += shifts
    poses[:, :3, :3] = poses[:, :3, :3] @ Rotation.from_rotvec(axes).as_matrix()
    return replace(track, world_from_box=poses)


def fitted(poses: ActorPoses, truth: Track, times: np.ndarray, steps: int = 200) -> dict:
    """Corrections that bring points on the box to where `truth` has them at some times."""
    points = torch.from_numpy(np.random.default_rng(4).uniform(-1, 1, (30, 3)) * truth.dimensions / 2).float()
    targets = {time: truth.interpolate_pose(time) for time in times}
    corrections = {name: value.requires_grad_(True) for name, value in poses.initial_corrections().items()}
    optimizer = torch.optim.Adam(corrections.values(), lr=0.01)
    for _ in range(steps):
        loss = torch.zeros(())
        for time, target in targets.items():
            found, goal = poses.at(time, corrections), torch.from_numpy(target).float()
            error = points @ found.rotations[1].T + found.shifts[1] - points @ goal[:3, :3].T - goal[:3, 3]
            loss = loss + error.square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    return {name: value.detach() for name, value in corrections.items()}


def errors(track: Track, truth: Track) -> tuple[np.ndarray, np.ndarray]:
    """Errors of every key: metres and degrees."""
    between = np.swapaxes(track.world_from_box[:, :3, :3], 1, 2) @ truth.world_from_box[:, :3, :3]
    metres = np.linalg.norm(track.world_from_box[:, :3, 3] - truth.world_from_box[:, :3, 3], axis=1)
    return metres, np.degrees(Rotation.from_matrix(between).magnitude())


def test_a_misplaced_track_is_pulled_back_by_what_is_seen_of_it(tracks):
    truth = tracks[0]
    wrong = misplaced(truth, np.random.default_rng(3), 0.3, 3.0)
    poses = ActorPoses((wrong,))
    corrections = fitted(poses, truth, np.linspace(0.0, 0.4, 9))
    before, after = errors(wrong, truth), errors(poses.correct_tracks(corrections)[0], truth)
    np.testing.assert_allclose(before[0], 0.3, atol=1e-6)
    np.testing.assert_allclose(before[1], 3.0, atol=1e-6)
    assert after[0].max() < 0.02
    assert after[1].max() < 0.2


def test_a_key_that_no_photo_sees_is_corrected_as_its_neighbours(tracks):
    truth = tracks[0]
    wrong = replace(truth, world_from_box=truth.world_from_box.copy())
    wrong.world_from_box[:, :3, 3] += [0.3, 0.0, 0.0]
    seen = truth.times[[0, 1, 3]]
    for times in (seen, seen + 0.004):
        poses = ActorPoses((wrong,), times.tolist())
        metres, _ = errors(poses.correct_tracks(fitted(poses, truth, times))[0], truth)
        assert metres.max() < 0.05, "the key between and the one behind too"
    jumping = ActorPoses((wrong,))
    metres, _ = errors(jumping.correct_tracks(fitted(jumping, truth, seen))[0], truth)
    assert metres[2] > 0.1, "what it would be without knowing the photos"


def test_keys_without_photos_are_passed_over(tracks):
    poses = ActorPoses(tracks, [0.0, 0.11, 0.3])  # nearest keys: 0, 1 and 3 of the first track, 1 of the second
    corrections = {name: value.requires_grad_(True) for name, value in random_corrections(poses, 0.05).items()}
    found = poses.at(0.2, corrections)
    (found.rotations.sum() + found.shifts.sum()).backward()
    touched = torch.nonzero(corrections["track_shifts"].grad.any(dim=1))[:, 0].tolist()
    assert touched == [1, 3, 6]
    refined = poses.correct_tracks(corrections)
    for node, track in enumerate(refined, start=1):
        for time in track.times:
            np.testing.assert_allclose(
                track.interpolate_pose(time), poses.at(time, corrections).matrices[node], atol=1e-6
            )
    assert ActorPoses(tracks, []).at(0.2, corrections).matrices[1] == pytest.approx(
        ActorPoses(tracks).at(0.2, corrections).matrices[1]
    )


def test_a_scene_without_actors_has_no_corrections():
    nobody = ActorPoses(())
    assert nobody.correct_tracks(nobody.initial_corrections()) == ()
    assert nobody.at(0.0, nobody.initial_corrections()).matrices.shape == (1, 4, 4)
