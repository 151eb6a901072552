"""Rows in view: never one too few, judged by the rasterizer's own projection; absent actors left out."""

import numba
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from instdrive_core.maths.activations import sigmoid
from instdrive_core.rasterize.kernels.project import project
from instdrive_core.rasterize.kernels.settings import DEFAULT_SETTINGS, RasterSettings
from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.scene.scene import place_in_world
from instdrive_core.training.gaussians.rows_in_view import find_rows_in_view
from instdrive_core.training.gaussians.rows_on_device import find_rows_on_device


def rotation(rng):
    matrix = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return matrix * np.sign(np.linalg.det(matrix))


def poses_of(rng, actors, reach):
    poses = np.tile(np.eye(4), (actors + 1, 1, 1))
    for pose in poses[1:]:
        pose[:3, :3], pose[:3, 3] = rotation(rng), rng.uniform(-reach, reach, 3)
    return poses


def any_camera(rng, reach):
    """From a telescope to a fisheye's width, principal point up to outside the image, turned any way."""
    width, height = (int(size) for size in rng.integers(1, 300, 2))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation(rng), rng.uniform(-reach, reach, 3)
    fx, fy = np.exp(rng.uniform(np.log(0.2), np.log(8), 2)) * [width, height]
    return Camera(fx, fy, rng.uniform(-0.4, 1.4) * width, rng.uniform(-0.4, 1.4) * height, width, height, pose)


def drawn_rows(means, quats, log_scales, logits, nodes, poses, present, camera, raster=DEFAULT_SETTINGS):
    world, turned = place_in_world(means, quats, nodes, poses)
    opacities = np.where(present[nodes], sigmoid(logits), np.float32(0))
    return np.sort(project(world, turned, log_scales, opacities, camera, raster).rows)


def find_in_torch(means, log_scales, logits, nodes, poses, present, camera, raster=DEFAULT_SETTINGS):
    """Look for rows where a GPU's trainer does."""
    tensors = [torch.from_numpy(values) for values in (means, log_scales, logits, nodes.astype(np.int32))]
    background = int((nodes == 0).sum())
    rows, places = find_rows_on_device(*tensors, background, poses, present, camera, raster)
    assert rows.dtype == places.of_rows.dtype == torch.int64
    assert places.of_rows.tolist() == nodes[rows.numpy()].tolist()
    assert places.background == (nodes[rows.numpy()] == 0).sum()
    return rows.numpy()


FINDERS = pytest.mark.parametrize("find_rows", [find_rows_in_view, find_in_torch], ids=["kernel", "in torch"])


def random_rows(rng, count, actors, reach, size):
    nodes = np.sort(rng.integers(0, actors + 1, count)).astype(np.uint16)
    spread = np.where(nodes == 0, reach, 3.0)[:, None]
    return (
        (rng.normal(0, 1, (count, 3)) * spread).astype(np.float32),
        rng.normal(size=(count, 4)).astype(np.float32),
        rng.normal(size, 2, (count, 3)).astype(np.float32),
        rng.normal(-2, 3, count).astype(np.float32),
        nodes,
    )


@FINDERS
@settings(max_examples=150, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    actors=st.integers(0, 4),
    reach=st.sampled_from([2.0, 30.0, 300.0, 3000.0]),
    size=st.sampled_from([-8.0, -2.0, 1.0, 4.0]),
    near=st.sampled_from([0.01, 0.1, 2.0]),
)
def test_no_row_that_would_be_drawn_is_lost(find_rows, seed, actors, reach, size, near):
    rng = np.random.default_rng(seed)
    means, quats, log_scales, logits, nodes = random_rows(rng, 600, actors, reach, size)
    poses, present = poses_of(rng, actors, reach), rng.random(actors + 1) < 0.7
    present[0] = True
    camera, raster = any_camera(rng, reach), RasterSettings(near=near)
    drawn = drawn_rows(means, quats, log_scales, logits, nodes, poses, present, camera, raster)
    rows = find_rows(means, log_scales, logits, nodes, poses, present, camera, raster)
    assert np.all(np.diff(rows) > 0)
    assert np.all(present[nodes[rows]])
    assert not set(drawn) - set(rows)


@FINDERS
@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**31), reach=st.sampled_from([1.0, 100.0, 5000.0]))
def test_splats_at_the_very_borders_are_kept(find_rows, seed, reach):
    """Opacity at the limit, centres on the near plane, reach that ends on the image's edge: rounding decides."""
    rng = np.random.default_rng(seed)
    camera, count = any_camera(rng, reach), 4000
    depths = rng.choice([0.1, 1.0, 20.0], count) * (1 + rng.uniform(-2e-6, 2e-6, count))
    sigmas = np.exp(rng.uniform(-1, 4, count))
    logits = rng.choice([np.log(1 / 254), -2.0, 3.0, 12.0], count).astype(np.float32) + rng.uniform(-1e-5, 1e-5, count)
    alphas = 1 / (1 + np.exp(-logits))
    reaches = np.sqrt(np.maximum(2 * np.log(255 * alphas), 0) * (sigmas**2 + 0.3))
    sides = rng.choice([-1, 1], count)
    beside = np.where(sides < 0, 0.5 - reaches, camera.width - 0.5 + reaches)
    pixels = np.stack([beside, rng.uniform(0, camera.height, count)], axis=1)
    local = (pixels - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
    # A ball's image is widest where the Jacobian's tangent is clamped.
    margin = 0.15 * camera.width
    tangents = (np.clip(pixels[:, 0], -margin, camera.width + margin) - camera.cx) / camera.fx
    points = np.concatenate([local, np.ones((count, 1))], axis=1) * depths[:, None]
    pose = camera.world_from_camera
    means = (points @ pose[:3, :3].T + pose[:3, 3]).astype(np.float32)
    scales = sigmas * depths / camera.fx / np.sqrt(1 + tangents**2)
    log_scales = np.repeat(np.log(scales)[:, None], 3, axis=1).astype(np.float32)
    quats = np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1))
    arguments = (logits.astype(np.float32), np.zeros(count, np.uint16), np.eye(4)[None], np.ones(1, bool), camera)
    drawn = drawn_rows(means, quats, log_scales, *arguments)
    rows = find_rows(means, log_scales, *arguments)
    assert not set(drawn) - set(rows)


@FINDERS
@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**31), reach=st.sampled_from([1.0, 100.0, 5000.0]))
def test_rounding_on_the_way_through_the_world_loses_nothing(find_rows, seed, reach):
    """An actor's points on the near plane and points as faint as can be: their frames round differently."""
    rng = np.random.default_rng(seed)
    camera, count, poses = any_camera(rng, reach), 4000, poses_of(rng, 1, reach)
    poses[1, :3, 3] = camera.position + rng.normal(0, 2, 3)
    inside = (rng.uniform(0.3, 0.7, (count, 2)) * [camera.width, camera.height]) - [camera.cx, camera.cy]
    local = np.concatenate([inside / [camera.fx, camera.fy], np.ones((count, 1))], axis=1)
    points = np.where(rng.random((count, 1)) < 0.5, 0.1, 5.0) * local
    world = points @ camera.world_from_camera[:3, :3].T + camera.position
    means = ((world - poses[1, :3, 3]) @ poses[1, :3, :3]).astype(np.float32)
    logits = (np.log(1 / 254) + rng.normal(0, 1e-5, count)).astype(np.float32)
    logits[points[:, 2] < 1] = 1
    quats, log_scales = rng.normal(size=(count, 4)).astype(np.float32), np.full((count, 3), -6, np.float32)
    arguments = (logits, np.ones(count, np.uint16), poses, np.ones(2, bool), camera)
    drawn = drawn_rows(means, quats, log_scales, *arguments)
    rows = find_rows(means, log_scales, *arguments)
    assert not set(drawn) - set(rows)


def street():
    rng = np.random.default_rng(3)
    means, quats, log_scales, logits, nodes = random_rows(rng, 30_000, 5, 15.0, -2.0)
    log_scales[:] = rng.normal(-2, 0.5, (len(means), 3))
    camera = Camera(500.0, 500.0, 480.0, 270.0, 960, 540, look_at(np.zeros(3), np.array([10.0, 3.0, 0.5])))
    poses, present = poses_of(rng, 5, 30.0), np.array([True, True, False, True, False, True])
    return means, quats, log_scales, logits, nodes, poses, present, camera


@FINDERS
def test_little_is_kept_in_vain(find_rows):
    means, quats, *others = street()
    drawn, rows = drawn_rows(means, quats, *others), find_rows(means, *others)
    assert 500 < len(drawn) <= len(rows) < 1.1 * len(drawn)


def test_rows_do_not_depend_on_the_threads():
    means, _, *others = street()
    threads = numba.get_num_threads()
    several = find_rows_in_view(means, *others)
    numba.set_num_threads(1)
    try:
        np.testing.assert_array_equal(find_rows_in_view(means, *others), several)
    finally:
        numba.set_num_threads(threads)


@FINDERS
def test_a_huge_splat_beside_the_image_is_kept(find_rows):
    camera = Camera(100.0, 100.0, 50.0, 40.0, 100, 80, np.eye(4))
    means = np.array([[400.0, 0, 10], [400, 0, 10], [0, 0, -5]], np.float32)
    log_scales = np.log(np.array([[0.1, 200, 0.1], [0.1, 0.1, 0.1], [50, 50, 50]], np.float32))
    nodes, present = np.zeros(3, np.uint16), np.ones(1, bool)
    rows = find_rows(means, log_scales, np.full(3, 2.0, np.float32), nodes, np.eye(4)[None], present, camera)
    assert rows.tolist() == [0]


@FINDERS
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_disturbs_no_other_row(find_rows, value):
    means, _, log_scales, logits, nodes, poses, present, camera = street()
    expected = find_rows(means, log_scales, logits, nodes, poses, present, camera)
    means[5], log_scales[17], logits[40] = value, value, value
    rows = find_rows(means, log_scales, logits, nodes, poses, present, camera)
    spoilt = {5, 17, 40}
    assert set(rows) - spoilt == set(expected) - spoilt


@FINDERS
def test_no_rows_at_all(find_rows):
    camera = Camera(10.0, 10.0, 5.0, 5.0, 10, 10, np.eye(4))
    none = np.zeros((0, 3), np.float32)
    nodes, present = np.zeros(0, np.uint16), np.ones(1, bool)
    rows = find_rows(none, none, np.zeros(0, np.float32), nodes, np.eye(4)[None], present, camera)
    assert rows.shape == (0,)
    assert rows.dtype == np.int64
