"""Pictures through a rolling shutter are those whose lines are drawn one by one, each at its own moment."""

from dataclasses import replace

import numpy as np
import pytest
from parked_street import CAR_SIZE, OTHER_CAR, parked_street

from instdrive_core.maths.rotations import matrix_from_quaternion, quaternion_from_matrix, slerp
from instdrive_core.rasterize.rolling_shutter import RollingCamera, skew_scene, view_through_shutter
from instdrive_core.rasterize.scene_view import build_instance_map, view_scene
from instdrive_core.scene.sky import Sky
from instdrive_core.scene.track import Track

BLOCK = 2
"""Lines of the reference that are drawn at one moment."""


@pytest.fixture(scope="module")
def scene():
    """The parked street under a sky of stripes; its other car drives across at 15 m/s."""
    street = parked_street().scene
    rows = np.flatnonzero(street.instance_ids == OTHER_CAR)
    center = street.gaussians.means[rows].mean(axis=0)
    means, nodes = street.gaussians.means.copy(), street.nodes.copy()
    means[rows] -= center
    nodes[rows] = 1
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[:, :3, 3] = np.stack([center - [0, 3.0, 0], center])
    track = Track("1", "Car", CAR_SIZE.copy(), np.array([0.0, 0.2]), poses, moving=True)
    sky = Sky(np.random.default_rng(0).random((6, 16, 16, 3)).astype(np.float32))
    gaussians = replace(street.gaussians, means=means)
    return replace(street, gaussians=gaussians, nodes=nodes, actors=(track,), sky=sky)


def make_rolling(scene, direction, turn=0.01, way=0.4, seconds=0.03):
    """The right camera, turning to the left and driving ahead."""
    view = next(each for each in scene.views if each.index == 7 and each.name == "right_camera")
    camera, ends = view.camera.resize(200, 120), []
    for share in (-0.5, 0.5):
        pose, angle = camera.world_from_camera.copy(), turn * share
        twist = np.array([np.cos(angle / 2), 0, 0, np.sin(angle / 2)])
        pose[:3, :3] = matrix_from_quaternion(twist) @ pose[:3, :3]
        pose[:3, 3] += np.array([0.0, way, 0.0]) * share
        ends.append(pose)
    return RollingCamera(camera, *ends, 0.1 - seconds / 2, 0.1 + seconds / 2, direction)


def draw_line_by_line(scene, rolling):
    """Colour, instances and depth of pictures of some lines each."""
    camera = rolling.camera
    count = camera.height if rolling.direction in ("down", "up") else camera.width
    quats = quaternion_from_matrix(np.stack([rolling.start[:3, :3], rolling.end[:3, :3]]))
    color = np.empty((camera.height, camera.width, 3), np.float32)
    ids, depth = np.empty(color.shape[:2], np.uint32), np.empty(color.shape[:2], np.float32)
    for first in range(0, count, BLOCK):
        share = (first + BLOCK / 2) / count
        share = share if rolling.direction in ("down", "right") else 1 - share
        pose = np.eye(4)
        pose[:3, :3] = matrix_from_quaternion(slerp(quats[0], quats[1], share))
        pose[:3, 3] = (1 - share) * rolling.start[:3, 3] + share * rolling.end[:3, 3]
        time = (1 - share) * rolling.start_time + share * rolling.end_time
        frame = view_scene(scene, replace(camera, world_from_camera=pose), time)
        lines = slice(first, first + BLOCK)
        part = lines if rolling.direction in ("down", "up") else (slice(None), lines)
        color[part], ids[part] = frame.color[part], build_instance_map(scene, frame)[part]
        depth[part] = np.where(frame.alpha > 0.5, frame.depth, 0)[part]
    return color, ids, depth


@pytest.mark.parametrize(("direction", "better"), [("down", 5), ("up", 5), ("right", 2), ("left", 2)])
def test_every_line_shows_its_own_moment(scene, direction, better):
    rolling = make_rolling(scene, direction)
    color, ids, depth = draw_line_by_line(scene, rolling)
    frame = view_through_shutter(scene, rolling)
    still = view_scene(scene, rolling.camera, rolling.time)
    missed, unmoved = np.abs(frame.color - color).mean(), np.abs(still.color - color).mean()
    assert unmoved > 0.008
    assert missed < unmoved / better
    found = build_instance_map(scene, frame)
    assert (found != ids).mean() < (build_instance_map(scene, still) != ids).mean() * 1.5 / better
    both = (depth > 0) & (frame.alpha > 0.5) & (found == ids)
    assert np.median(np.abs(frame.depth - depth)[both]) < 0.01


def test_nothing_changes_where_nothing_moves(scene):
    rolling = make_rolling(scene, "down", turn=0.0, way=0.0, seconds=0.0)
    frame, still = view_through_shutter(scene, rolling), view_scene(scene, rolling.camera, rolling.time)
    np.testing.assert_allclose(frame.color, still.color, atol=1e-3)


def test_what_is_behind_the_camera_or_not_finite_stays(scene):
    means = scene.gaussians.means.copy()
    means[0] = np.nan
    broken = replace(scene, gaussians=replace(scene.gaussians, means=means))
    rolling = make_rolling(scene, "down")
    skewed = skew_scene(broken, rolling).gaussians.means
    behind = rolling.camera.project(means[1:])[1] < -2
    still = behind & (scene.nodes[1:] == 0)
    assert still.any()
    np.testing.assert_array_equal(skewed[1:][still], means[1:][still])
    assert np.isnan(skewed[0]).all()
