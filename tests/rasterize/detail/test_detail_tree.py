"""Merged splats: their moments against NumPy, and cuts that show each splat in the view exactly once."""

import numpy as np
import pytest

from instdrive_core.maths.activations import sigmoid
from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.maths.workspace import Workspace
from instdrive_core.rasterize.detail import tree as detail_tree
from instdrive_core.rasterize.detail.cut import choose_cut
from instdrive_core.rasterize.detail.fit import LeafState, NodeState
from instdrive_core.rasterize.detail.gather import gather_cut
from instdrive_core.rasterize.detail.moments import add_covariance, split_covariance
from instdrive_core.rasterize.detail.order import order_splats
from instdrive_core.rasterize.detail.tree import build_detail_tree
from instdrive_core.rasterize.kernels.project import project
from instdrive_core.rasterize.kernels.settings import DEFAULT_SETTINGS
from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.scene.gaussians import Gaussians

COUNT = 5003
INSTANCES = 12


def covariances(quats, log_scales):
    turned = matrix_from_quaternion(np.asarray(quats, float)) * np.exp(np.asarray(log_scales, float))[:, None]
    return turned @ turned.transpose(0, 2, 1)


@pytest.fixture(scope="module")
def scene():
    """Things of several hundred small splats each, some way apart, in rows that follow no order."""
    rng = np.random.default_rng(4)
    ids = rng.integers(0, INSTANCES, COUNT).astype(np.uint32)
    centers = rng.uniform(-20, 20, (INSTANCES, 3))
    gaussians = Gaussians(
        means=(centers[ids] + rng.normal(0, 0.6, (COUNT, 3))).astype(np.float32),
        quats=rng.normal(size=(COUNT, 4)).astype(np.float32),
        log_scales=rng.uniform(-5, -2, (COUNT, 3)).astype(np.float32),
        opacity_logits=rng.normal(0, 2, COUNT).astype(np.float32),
        sh_dc=rng.normal(size=(COUNT, 3)).astype(np.float32),
        sh_rest=rng.normal(0, 0.2, (COUNT, 8, 3)).astype(np.float32),
        features=np.zeros((COUNT, 0), np.float32),
    )
    return gaussians, ids, (ids > 9).astype(np.uint16)


@pytest.fixture(scope="module")
def tree(scene):
    return build_detail_tree(*scene)


def leaf_state(scene, hidden=(), **changes):
    gaussians, ids, nodes = scene
    opacities = sigmoid(gaussians.opacity_logits).astype(np.float32)
    opacities[np.isin(ids, hidden)] = 0
    given = {"frames": nodes.astype(np.int32), "color_entries": np.zeros(COUNT, np.uint16), "instance_ids": ids}
    return LeafState(gaussians.means, gaussians.log_scales, opacities, **(given | changes))


def fitted(tree, leaves):
    state = NodeState(tree)
    state.fit(np.arange(tree.block_count), leaves)
    return state


def descendants(tree, node):
    level = int(np.searchsorted(tree.starts, node, side="right")) - 1
    place = (node - tree.starts[level]) * 4**level
    return tree.order[place : place + 4**level]


def camera(distance=30.0, width=320, height=180):
    place = look_at(np.array([distance, -8, 9.0]), np.zeros(3))
    return Camera(300.0, 310.0, width / 2, height / 2, width, height, place)


def test_covariances_are_split_into_what_they_were_made_of():
    rng = np.random.default_rng(0)
    for _ in range(200):
        quat, log_scales = rng.normal(size=4), rng.uniform(-6, 2, 3)
        total, room = np.zeros(6), np.empty((2, 3, 3))
        add_covariance(quat, log_scales, 1.0, total)
        expected = covariances(quat[None] / np.linalg.norm(quat), log_scales[None])[0]
        np.testing.assert_allclose(total, expected[np.triu_indices(3)], atol=1e-9 * expected.max())
        found_quat, found_scales = np.empty(4), np.empty(3)
        split_covariance(total, *room, found_quat, found_scales)
        assert abs(np.linalg.norm(found_quat) - 1) < 1e-9
        found = covariances(found_quat[None], found_scales[None])[0]
        np.testing.assert_allclose(found, expected, atol=1e-7 * expected.max())


def test_the_order_keeps_instances_and_bodies_together(scene, tree):
    _, ids, nodes = scene
    assert np.array_equal(np.sort(tree.order), np.arange(COUNT))
    assert (np.diff(ids[tree.order].astype(int)) != 0).sum() == INSTANCES - 1
    assert (np.diff(nodes[tree.order].astype(int)) != 0).sum() == 1
    far = order_splats(scene[0].means, ids * np.uint32(1 << 27), nodes)  # IDs too large to be listed
    assert (np.diff(ids[far].astype(int)) != 0).sum() == INSTANCES - 1


def test_nodes_have_the_moments_of_what_they_stand_for(scene, tree):
    gaussians = scene[0]
    opacities = sigmoid(gaussians.opacity_logits.astype(float))
    scales = np.sort(np.exp(gaussians.log_scales.astype(float)), axis=1)
    shares = covariances(gaussians.quats / np.linalg.norm(gaussians.quats, axis=1, keepdims=True), gaussians.log_scales)
    for node in range(0, int(tree.starts[2]), 97):
        rows = descendants(tree, node)
        weights = opacities[rows] * scales[rows, 1] * scales[rows, 2]
        mean = np.average(gaussians.means[rows], axis=0, weights=weights)
        apart = gaussians.means[rows] - mean
        spread = np.average(shares[rows] + apart[:, :, None] * apart[:, None], axis=0, weights=weights)
        np.testing.assert_allclose(tree.means[node], mean, atol=1e-4)
        found = covariances(tree.quats[node : node + 1], tree.log_scales[node : node + 1])[0]
        np.testing.assert_allclose(found, spread, atol=1e-4 * spread.max())
        sizes = np.sqrt(np.linalg.eigvalsh(spread))
        assert tree.opacities[node] == pytest.approx(min(weights.sum() / (sizes[1] * sizes[2]), 0.999), rel=1e-3)
        expected = np.average(gaussians.sh_rest[rows, :3], axis=0, weights=weights)
        np.testing.assert_allclose(tree.sh_rest[node], expected, atol=1e-5)


@pytest.mark.parametrize("tolerance", [0.0, 0.5, 2.0, 30.0])
@pytest.mark.parametrize("distance", [8.0, 30.0, 200.0])
def test_a_cut_holds_each_visible_splat_once(scene, tree, tolerance, distance):
    leaves, view = leaf_state(scene), camera(distance)
    cut = choose_cut(fitted(tree, leaves), view, tolerance, 0.1, Workspace())
    held = np.concatenate([cut.splats, *(descendants(tree, node) for node in cut.nodes)])
    assert len(np.unique(held)) == len(held)
    gaussians = scene[0]
    shapes = gaussians.means, gaussians.quats, gaussians.log_scales, leaves.opacities
    seen = project(*shapes, view, DEFAULT_SETTINGS).rows
    assert len(np.setdiff1d(seen, held)) == 0
    assert not len(cut.nodes) or tolerance
    if tolerance == 30 and distance > 10:
        assert len(cut.splats) + len(cut.nodes) < len(seen) / 10


def test_nodes_of_splats_that_differ_are_never_drawn(scene, tree):
    _, ids, _ = scene
    colors = (np.arange(COUNT) % 2).astype(np.uint16)
    mixed = fitted(tree, leaf_state(scene, color_entries=colors))
    cut = choose_cut(mixed, camera(), 1e6, 0.1, Workspace())
    assert all(len(np.unique(colors[descendants(tree, node)])) == 1 for node in cut.nodes)
    halved = fitted(tree, leaf_state(scene, hidden=(3,)))
    cut = choose_cut(halved, camera(), 1e6, 0.1, Workspace())
    assert all((ids[descendants(tree, node)] != 3).all() for node in cut.nodes)
    assert all(len(np.unique(ids[descendants(tree, node)])) == 1 for node in cut.nodes)
    assert not len(choose_cut(fitted(tree, leaf_state(scene, hidden=range(12))), camera(), 1.0, 0.1, Workspace()).nodes)


def test_a_fit_of_what_changed_equals_one_of_everything(scene, tree):
    moved = scene[0].means.copy()
    before, state = leaf_state(scene), NodeState(tree)
    state.fit(np.arange(tree.block_count), before)
    rows = np.flatnonzero(scene[1] == 5)
    moved[rows] += np.float32(40)
    after = LeafState(moved, *list(vars(leaf_state(scene, hidden=(2,))).values())[1:])
    changed = (moved != before.means).any(axis=1) | (after.opacities != before.opacities)
    blocks = state.find_blocks(changed)
    assert 0 < len(blocks) < tree.block_count
    state.fit(blocks, after)
    whole = fitted(tree, after)
    np.testing.assert_array_equal(state.rows, whole.rows)
    np.testing.assert_array_equal(state.spheres, whole.spheres)


def test_what_is_gathered_is_the_splat_or_its_node(scene, tree):
    leaves, gaussians = leaf_state(scene), scene[0]
    state = fitted(tree, leaves)
    cut = choose_cut(state, camera(), 2.0, 0.1, Workspace())
    found = gather_cut(cut, state, leaves, gaussians.quats, np.array([0.5], np.float32), Workspace())
    a = found.splat_count
    assert 0 < a < len(found.rows)
    np.testing.assert_array_equal(found.means, np.concatenate([gaussians.means[cut.splats], tree.means[cut.nodes]]))
    np.testing.assert_array_equal(found.opacities[:a], leaves.opacities[cut.splats])
    np.testing.assert_allclose(found.opacities[a:], 0.5 * tree.opacities[cut.nodes])
    assert all(row in descendants(tree, node) for row, node in zip(found.rows[a:], cut.nodes, strict=True))


def test_trees_are_made_in_turns(scene, tree, monkeypatch):
    turns = []
    monkeypatch.setattr(detail_tree, "_PORTION", 97)
    made = build_detail_tree(*scene, lambda: turns.append(1))
    assert len(turns) > len(tree.means) / 97
    for name, values in vars(tree).items():
        np.testing.assert_array_equal(values, getattr(made, name))


def test_scenes_without_splats_and_with_broken_ones_have_trees(scene):
    gaussians, ids, nodes = scene
    empty = build_detail_tree(Gaussians(**{k: v[:0] for k, v in gaussians.arrays().items()}), ids[:0], nodes[:0])
    assert empty.block_count == 0
    assert not len(choose_cut(NodeState(empty), camera(), 1.0, 0.1, Workspace()).splats)
    arrays = {name: array.copy() for name, array in gaussians.arrays().items()}
    arrays["means"][7], arrays["log_scales"][9] = np.nan, np.inf
    broken = build_detail_tree(Gaussians(**arrays), ids, nodes)
    assert np.isfinite(broken.means).all()
    assert np.isfinite(broken.log_scales).all()


def test_what_reaches_into_the_picture_by_its_faintest_part_is_in_every_cut():
    rng = np.random.default_rng(7)
    count, view = 4000, camera(30.0, 640, 180)
    means = np.repeat(rng.uniform(-15, 15, (count // 4, 3)), 4, axis=0).astype(np.float32)
    scales = np.repeat(rng.uniform(-6, 0, (count // 4, 1)), 4, axis=0).repeat(3, axis=1).astype(np.float32)
    gaussians = Gaussians(
        means=means,
        quats=np.tile(np.float32([1, 0, 0, 0]), (count, 1)),
        log_scales=scales,
        opacity_logits=np.full(count, 8, np.float32),
        sh_dc=np.zeros((count, 3), np.float32),
        sh_rest=np.zeros((count, 0, 3), np.float32),
        features=np.zeros((count, 0), np.float32),
    )
    ids, zeros = np.zeros(count, np.uint32), np.zeros(count, np.uint16)
    opacities = gaussians.opacities
    leaves = LeafState(means, scales, opacities, zeros.astype(np.int32), zeros, ids)
    cut = choose_cut(fitted(build_detail_tree(gaussians, ids, zeros), leaves), view, 0.0, 0.1, Workspace())
    seen = project(means, gaussians.quats, scales, opacities, view, DEFAULT_SETTINGS).rows
    assert 0.2 * count < len(seen) < 0.9 * count
    assert len(np.setdiff1d(seen, cut.splats)) == 0
