"""LiDAR's things as the masks of one more photo."""

import numpy as np
import pytest
from scipy.sparse import csr_array

from instdrive_core.masks.lidar.cluster_kind import FACADE, GROUND, NONE, THING
from instdrive_core.masks.lidar.scene import LidarScene
from instdrive_core.training.instances.affinity_graph import merge_groups
from instdrive_core.training.instances.lidar_things import add_lidar_masks, assign_lidar_things, measure_silence
from instdrive_core.training.instances.mask_weights import MaskWeights
from instdrive_core.training.settings.config import GraphConfig

KINDS = np.array([NONE, GROUND, FACADE, THING, THING], np.uint32)
POINTS = np.array([[0, 0, 0], [5, 0, 2], [10, 0, 1], [20, 0, 1]], np.float32)
LIDAR = LidarScene(POINTS, np.array([1, 2, 3, 4], np.uint32), KINDS, {})


def test_gaussians_of_the_background_take_the_thing_of_the_nearest_point_within_reach():
    close, far = np.array([[0.1, 0, 0], [0.5, 0, 0]])
    means = np.concatenate([POINTS + close, POINTS[2:] + far, POINTS[2:3]])
    nodes = np.array([0, 0, 0, 0, 0, 0, 7], np.uint16)
    np.testing.assert_array_equal(assign_lidar_things(means, nodes, LIDAR, 0.3), [-1, -1, 3, 4, -1, -1, -1])
    nothing = LidarScene(POINTS[:0], np.zeros(0, np.uint32), KINDS, {})
    np.testing.assert_array_equal(assign_lidar_things(means, nodes, nothing, 0.3), np.full(7, -1))


def weigh(weights, unmasked, layers=1, views=None):
    weights, unmasked = np.array(weights, np.float32), np.array(unmasked, np.float32)
    views = np.arange(weights.shape[1]) * layers if views is None else views
    shown = weights.sum(axis=1) / np.float32(layers) + unmasked
    return MaskWeights(csr_array(weights), np.array(views, np.int32), layers, unmasked, shown)


def test_silence_is_the_weight_in_no_mask_by_that_in_masks():
    everything = np.ones(3, bool)
    assert measure_silence(weigh([[2], [1], [1]], [0, 0, 0]), everything) == 0
    assert measure_silence(weigh([[2], [1], [1]], [0, 1, 0]), everything) == pytest.approx(0.25)
    assert measure_silence(weigh([[2], [1], [1]], [0, 1, 0]), np.array([True, False, True])) == 0
    assert measure_silence(weigh([[2, 2], [1, 1], [1, 1]], [0, 1, 0], 2, [0, 1]), everything) == pytest.approx(0.25)
    assert measure_silence(weigh([[0], [0], [1]], [9, 9, 9]), everything) == 1  # no more say than all photos


def test_the_added_photo_holds_a_share_of_each_gaussians_weight():
    observed = weigh([[2, 2, 0], [0, 0, 4], [0, 0, 0], [1, 1, 1]], [1, 0, 3, 0], 2, [0, 1, 2])
    joined = add_lidar_masks(observed, np.array([9, 4, 4, -1]), 0.5)
    np.testing.assert_array_equal(joined.view_of_mask, [0, 1, 2, 4, 4])  # a photo of its own after photos 0 and 1
    np.testing.assert_allclose(joined.weights.toarray()[:, :3], observed.weights.toarray())
    np.testing.assert_allclose(joined.weights.toarray()[:, 3:], [[0, 1.5], [1, 0], [1.5, 0], [0, 0]])
    assert add_lidar_masks(observed, np.full(4, -1), 0.5) is observed
    assert add_lidar_masks(observed, np.array([9, 4, 4, -1]), 0.0) is observed


@pytest.mark.parametrize(("share", "objects"), [(0.0, 1), (1.0, 2)])
def test_two_cars_that_one_mask_joins_in_most_photos_fall_apart(share, objects):
    """Three photos show a car on each side: two in one mask, one apart. LiDAR weighs as much as all of them."""
    left, right = [1, 1, 1, 0], [1, 1, 0, 1]
    observed = weigh([left, left, right, right], [0, 0, 0, 0], 1, [0, 1, 2, 2])
    joined = add_lidar_masks(observed, np.array([3, 3, 4, 4]), share)
    pairs = np.array([[0, 1], [1, 2], [2, 3]])
    groups = merge_groups(joined, np.arange(4), pairs, GraphConfig())
    assert len(np.unique(groups)) == objects
    assert groups[0] == groups[1]
    assert groups[2] == groups[3]
