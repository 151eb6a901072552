"""Checkpoints of drivestudio train on with the clip that they were made of; those without a place are refused."""

import dataclasses

import numpy as np
import pytest
from small_clip import WHOLE, write_layout, write_small_clip

from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import DataError
from instdrive_core.formats.actors.sample_files import write_street_tracks
from instdrive_core.formats.checkpoints.sample_files import (
    build_class_state,
    build_gsplat_content,
    build_street_content,
    write_checkpoint,
)
from instdrive_core.formats.registry import open_scene
from instdrive_core.maths.rotations import quaternion_from_matrix
from instdrive_core.scene.sky import compute_texel_directions
from instdrive_core.training.trainer_world import move_to_clip_world

START = 3
TURN = np.array([[0.6, -0.8, 0, 0], [0.8, 0.6, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])


@pytest.fixture
def clip(tmp_path):
    """The drive in drivestudio's layout, by a car that does not look along an axis of its world, from step 3 on."""
    folder = write_layout("drivestudio", tmp_path / "clip")
    for file in (folder / "ego_pose").iterdir():
        np.savetxt(file, np.loadtxt(file) @ TURN)
    return load_clip(str(folder), dataclasses.replace(WHOLE, first_frame=START))


def write_trained(folder, clip, points, settings="data:\n  start_timestep: 3\n"):
    """What drivestudio would have trained: `points` (in the clip) and the first moving car, with red sky ahead."""
    own = clip.start_poses[START].copy()
    own[:3, 3] -= clip.origin
    from_clip = np.linalg.inv(own)
    track = next(track for track in clip.tracks if track.moving)
    poses = from_clip @ track.world_from_box
    rng = np.random.default_rng(3)
    background = build_class_state(rng, len(points))
    background["_means"] = (points @ from_clip[:3, :3].T + from_clip[:3, 3]).astype(np.float32)
    steps = np.round(track.times / 0.1).astype(int)
    frames = max(steps) - START + 1
    rows = steps - START
    kept = rows >= 0
    there = np.zeros((frames, 1), bool)
    there[rows[kept]] = True
    quats, places = np.zeros((frames, 1, 4), np.float32), np.zeros((frames, 1, 3), np.float32)
    quats[..., 0] = 1
    for row, pose in zip(rows[kept], poses[kept], strict=True):
        quats[row, 0], places[row, 0] = quaternion_from_matrix(pose[:3, :3]), pose[:3, 3]
    rigid = build_class_state(rng, 8, points_ids=np.zeros((8, 1), np.int64), instances_fv=there)
    size = track.dimensions.astype(np.float32)[None]
    rigid |= {"instances_quats": quats, "instances_trans": places, "instances_size": size}
    texture = np.zeros((6, 16, 16, 3), np.float32)
    texture[0, ..., 0] = 1  # along x, where the car looks
    content = {"models": {"Background": background, "RigidNodes": rigid, "Sky": {"base": texture}}, "step": 30000}
    path = write_checkpoint(folder / "checkpoint_final.pth", content)
    if settings:
        (folder / "config.yaml").write_text(settings)
    return path, track, kept


def test_splats_tracks_and_sky_come_to_where_the_clip_is(clip, tmp_path):
    points = np.random.default_rng(1).uniform(-20, 20, (30, 3))
    path, track, kept = write_trained(tmp_path / "run", clip, points)
    scene = move_to_clip_world(open_scene(path), path, clip)
    np.testing.assert_allclose(scene.gaussians.means[:30], points, atol=1e-4)
    (moved,) = scene.actors
    np.testing.assert_allclose(moved.times, track.times[kept], atol=1e-9)
    np.testing.assert_allclose(moved.world_from_box[:, :3, 3], track.world_from_box[kept, :3, 3], atol=1e-4)
    np.testing.assert_array_equal(scene.origin, clip.origin)
    directions = compute_texel_directions(16).reshape(-1, 3)
    reds = directions[scene.sky.faces.reshape(-1, 3)[:, 0] > 0.5].mean(axis=0)
    ahead = clip.start_poses[START][:3, 0]
    assert reds @ ahead / np.linalg.norm(reds) > 0.99


def test_without_settings_training_began_at_the_first_step(clip, tmp_path):
    path, _, _ = write_trained(tmp_path / "run", clip, np.zeros((30, 3)), settings="")
    before = open_scene(path).gaussians.means[:30].astype(np.float64)
    scene = move_to_clip_world(open_scene(path), path, clip)
    pose = clip.start_poses[0]
    np.testing.assert_allclose(
        scene.gaussians.means[:30], before @ pose[:3, :3].T + pose[:3, 3] - clip.origin, atol=1e-4
    )


def test_a_start_that_the_clip_does_not_have_is_refused(clip, tmp_path):
    path, _, _ = write_trained(tmp_path / "run", clip, np.zeros((30, 3)), "data:\n  start_timestep: 77\n")
    with pytest.raises(DataError, match=r"from step 77 on.*has no such step"):
        move_to_clip_world(open_scene(path), path, clip)


def test_settings_without_a_start_are_refused(clip, tmp_path):
    path, _, _ = write_trained(tmp_path / "run", clip, np.zeros((30, 3)), settings="data:\n  end_timestep: 9\n")
    with pytest.raises(DataError, match=r"config\.yaml.*start_timestep"):
        move_to_clip_world(open_scene(path), path, clip)


def test_another_drive_than_drivestudios_is_refused(clip, tmp_path):
    path, _, _ = write_trained(tmp_path / "run", clip, np.zeros((30, 3)))
    other = load_clip(str(write_small_clip(tmp_path / "other")), WHOLE)
    with pytest.raises(DataError, match="was not preprocessed by drivestudio"):
        move_to_clip_world(open_scene(path), path, other)


def test_a_checkpoint_of_street_gaussians_has_no_place_in_a_clip(clip, tmp_path):
    rng = np.random.default_rng(1)
    path = write_checkpoint(tmp_path / "run" / "iteration_50000.pth", build_street_content(rng))
    write_street_tracks(path.parent)
    with pytest.raises(DataError, match="is not known"):
        move_to_clip_world(open_scene(path), path, clip)


def test_scenes_of_no_other_trainer_stay_where_they_are(clip, tmp_path):
    path = write_checkpoint(tmp_path / "ckpt_1_rank0.pt", build_gsplat_content(np.random.default_rng(2)))
    scene = open_scene(path)
    before = scene.gaussians.means.copy()
    np.testing.assert_array_equal(move_to_clip_world(scene, path, clip).gaussians.means, before)
