"""Objects are found above the ground, apart where they are apart, and nothing else is one."""

import numpy as np
import pytest

from instdrive_core.instances.found_objects import estimate_unit, find_objects
from instdrive_core.instances.ground_surface import measure_heights_above_ground


def make_street(slope=0.0, scale=1.0):
    """A road with two cars 1 m apart, a post, a house and a lamp in the air; returns columns and true parts."""
    rng = np.random.default_rng(5)

    def box(size, low, count):
        return rng.uniform(0, 1, (count, 3)) * size + low

    parts = [
        box([60, 40, 0.05], [-30, -20, 0], 40000),
        box([1.8, 4.4, 1.3], [0, 0, 0.2], 3000),
        box([1.8, 4.4, 1.3], [2.8, 0, 0.2], 3000),
        box([0.2, 0.2, 4.5], [8, 4, 0.2], 300),
        box([20, 12, 9], [10, -18, 0], 30000),
        box([1, 1, 0.5], [-8, 5, 3], 300),
    ]
    means = np.concatenate(parts)
    means[:, 2] += slope * means[:, 0]
    truth = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    colors = np.array([[0.4, 0.4, 0.4], [0.8, 0.1, 0.1], [0.1, 0.1, 0.8], [0.5, 0.5, 0.5], [0.7, 0.6, 0.5], [1, 1, 1]])
    return scale * means, np.full_like(means, 0.05 * scale), colors[truth], np.full(len(means), 0.8), truth


@pytest.mark.parametrize("slope", [0.0, 0.06])
@pytest.mark.parametrize("scale", [1.0, 0.01])
def test_cars_and_posts_are_objects_and_houses_are_not(slope, scale):
    means, scales, colors, opacities, truth = make_street(slope, scale)
    unit = 1.0 if scale == 1 else scale
    numbers = find_objects(means, scales, colors, opacities, np.ones(len(means), bool), unit)
    assert numbers.max() == 3
    for part in (1, 2, 3):
        found, counts = np.unique(numbers[truth == part], return_counts=True)
        best = found[counts.argmax()]
        assert best > 0
        union = np.count_nonzero((numbers == best) | (truth == part))
        assert counts.max() / union > 0.9
    for part in (0, 4, 5):
        assert np.mean(numbers[truth == part] > 0) < 0.01


def test_things_nearer_than_the_gap_are_one():
    means, scales, colors, opacities, truth = make_street()
    colors[truth == 2] = colors[truth == 1][0]
    means[truth == 2, 0] -= 0.85
    numbers = find_objects(means, scales, colors, opacities, np.ones(len(means), bool), 1.0)
    assert numbers.max() == 2
    pair = numbers[np.isin(truth, (1, 2))]
    assert np.mean(pair == np.bincount(pair).argmax()) > 0.9
    assert np.bincount(pair).argmax() > 0


def test_splats_that_are_not_free_tell_of_the_ground_only():
    means, scales, colors, opacities, truth = make_street()
    numbers = find_objects(means, scales, colors, opacities, truth == 2, 1.0)
    assert numbers.max() == 1
    assert not numbers[truth != 2].any()


def test_the_ground_is_followed_under_what_hides_it():
    means, _, _, _, truth = make_street(slope=0.1)
    means[7] = np.nan
    heights = measure_heights_above_ground(means, np.ones(len(means), bool), 1.0)
    assert np.isnan(heights[7])
    inside = ~np.isnan(heights)
    level = means[:, 2] - 0.1 * means[:, 0]
    near = inside & (np.abs(means[:, :2]) < [9, 15]).all(axis=1) & (truth != 4)
    assert np.median(np.abs(heights - level)[near]) < 0.05
    assert np.abs(heights - level)[near].max() < 0.4


@pytest.mark.parametrize("usable", [0, 1])
def test_nothing_known_of_the_ground_finds_nothing(usable):
    means, solid = np.zeros((5, 3)), np.arange(5) < usable
    heights = measure_heights_above_ground(means, solid, 1.0)
    assert np.isnan(heights).all() == (usable == 0)
    scales, colors = np.full((5, 3), 0.05), np.zeros((5, 3))
    assert not find_objects(means, scales, colors, solid * 0.9, np.ones(5, bool), 1.0).any()


def test_small_scenes_are_models_of_a_street():
    rng = np.random.default_rng(0)
    assert estimate_unit(rng.uniform(0, 3, (1000, 3))) == pytest.approx(0.09, abs=0.01)
    assert estimate_unit(rng.uniform(0, 300, (1000, 3))) == 1.0
    assert estimate_unit(np.full((3, 3), np.nan)) == 1.0
