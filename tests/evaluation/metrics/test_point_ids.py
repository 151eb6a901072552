"""IDs of points by the Gaussians around them."""

from dataclasses import replace

import numpy as np
import pytest
from evaluation_scene import DRIVING, PARKED, ROAD

from instdrive_core.evaluation.metrics.point_ids import TOLERANCE, PointSupport, compute_point_support, vote_point_ids
from instdrive_core.evaluation.metrics.world_gaussians import place_world_gaussians
from instdrive_core.maths.activations import logit
from instdrive_core.maths.rotations import matrix_from_quaternion, normalize_quaternions
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import scene_from_gaussians


def blobs(means, scales, opacities, quats=None):
    count = len(means)
    return scene_from_gaussians(
        Gaussians(
            means=np.array(means, np.float32),
            quats=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)) if quats is None else quats,
            log_scales=np.log(np.array(scales, np.float32)),
            opacity_logits=logit(np.array(opacities, np.float32)),
            sh_dc=np.zeros((count, 3), np.float32),
            sh_rest=np.zeros((count, 0, 3), np.float32),
            features=np.zeros((count, 0), np.float32),
        )
    )


def ids_at(scene, point, ids, time=0.0):
    return vote_point_ids(
        compute_point_support(scene, np.array([point], np.float32), time), np.array(ids, np.uint32)
    ).ids[0]


def test_weights_as_written_down():
    rng = np.random.default_rng(0)
    quats = rng.normal(size=(20, 4)).astype(np.float32)
    scene = blobs(rng.normal(size=(20, 3)), rng.uniform(0.01, 0.5, (20, 3)), rng.uniform(0.05, 0.95, 20), quats)
    points = rng.normal(size=(7, 3)).astype(np.float32)
    support = compute_point_support(scene, points, 0.0)
    world = place_world_gaussians(scene, 0.0)
    turns = matrix_from_quaternion(normalize_quaternions(quats.astype(np.float64)))
    for p, point in enumerate(points):
        assert sorted(support.rows[p].tolist()) == list(range(20)), "there are no more than 20"
        for k, row in enumerate(support.rows[p]):
            scales = np.diag(np.exp(2 * world.log_scales[row].astype(np.float64)))
            covariance = turns[row] @ scales @ turns[row].T + TOLERANCE**2 * np.eye(3)
            offset = point - world.means[row]
            expected = world.opacities[row] * np.exp(-0.5 * offset @ np.linalg.inv(covariance) @ offset)
            assert support.weights[p, k] == pytest.approx(expected, rel=1e-4, abs=1e-7)


def test_many_faint_ones_outvote_a_near_one():
    scene = blobs([[0.02, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], np.full((3, 3), 0.1), [0.5, 0.4, 0.4])
    assert ids_at(scene, [0, 0, 0], [1, 2, 2]) == 2
    assert ids_at(scene, [0, 0, 0], [1, 2, 3]) == 1


def test_opacity_and_extent_count():
    scene = blobs([[0.1, 0, 0], [-0.3, 0, 0]], [[0.02, 0.02, 0.02], [0.5, 0.02, 0.02]], [0.9, 0.9])
    assert ids_at(scene, [0, 0, 0], [1, 2]) == 2, "the farther one stretches over the point"
    faint = blobs([[0.1, 0, 0], [-0.3, 0, 0]], [[0.02, 0.02, 0.02], [0.5, 0.02, 0.02]], [0.9, 0.1])
    assert ids_at(faint, [0, 0, 0], [1, 2]) == 1


def test_empty_space_has_no_id():
    scene = blobs([[0, 0, 0]], [[0.1, 0.1, 0.1]], [0.9])
    assert ids_at(scene, [2, 0, 0], [5]) == 0
    assert ids_at(scene, [0.1, 0, 0], [5]) == 5
    assert ids_at(blobs(np.zeros((0, 3)), np.ones((0, 3)), []), [0, 0, 0], []) == 0


def test_gaussians_without_id_vote_for_none():
    scene = blobs([[0, 0, 0], [0.1, 0, 0]], np.full((2, 3), 0.1), [0.9, 0.3])
    assert ids_at(scene, [0, 0, 0], [0, 5]) == 0


def test_shares_and_wide_ids():
    support = PointSupport(np.array([[0, 1, 2]], np.int32), np.array([[0.2, 0.5, 0.3]], np.float32))
    code = np.uint64(2**32)
    found = vote_point_ids(support, np.array([code, 7, code], np.uint64))
    assert found.ids.tolist() == [2**32], "equal sums: the nearest Gaussian's"
    assert found.shares[0] == pytest.approx(0.5)


def test_actors_are_where_they_are_at_the_time(drive):
    scene, track = drive.scene, drive.clip.tracks[1]
    ids = scene.instance_ids
    for time in (0.4, 1.4):
        top = track.interpolate_pose(time)[:3, 3] + [0, 0, track.dimensions[2] / 2]
        assert ids_at(scene, top, ids, time) == DRIVING
        assert ids_at(scene, [*top[:2], 0.0], ids, time) in (ROAD, DRIVING)
    assert ids_at(scene, drive.clip.tracks[1].interpolate_pose(0.4)[:3, 3] + [0, -1.9, 0.75], ids, 1.9) == 0
    assert ids_at(scene, [2.5, 8.0, 1.6], ids, 0.4) == PARKED


def test_absent_actors_are_nowhere(drive):
    scene = drive.scene
    scene.actors = (replace(scene.actors[0], times=scene.actors[0].times + 100),)
    top = drive.clip.tracks[1].interpolate_pose(0.4)[:3, 3] + [0, 0, 0.8]
    assert ids_at(scene, top, scene.instance_ids, 0.4) == 0
