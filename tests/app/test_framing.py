"""The first view and Home show the dense part of a scene, large, and from where nothing stands before it."""

import numpy as np
import pytest
from procedural_street import procedural_street

from instdrive_app.framing import find_dense_core, frame_core, frame_scene, frame_thing
from instdrive_app.state import make_default_viewpoint


def cluster_with_floaters(rng):
    """A cluster of 2 m height and as many floaters, as a third, up to 300 m away."""
    cluster = rng.uniform(-1, 1, (3000, 3)) + np.array([4.0, 7.0, 1.0])
    return cluster, np.concatenate([cluster, rng.normal(0, 100, (1000, 3))])


def test_the_dense_core_leaves_floaters_out():
    _, points = cluster_with_floaters(np.random.default_rng(1))
    core = find_dense_core(points)
    low, high = np.percentile(core, [1, 99], axis=0)
    assert np.all(low > [2.5, 5.5, -0.5])
    assert np.all(high < [5.5, 8.5, 2.5])
    assert len(core) > 0.6 * len(points)


def test_the_core_takes_four_fifths_of_the_height():
    cluster, points = cluster_with_floaters(np.random.default_rng(2))
    found = frame_core(make_default_viewpoint(), points).fit_camera(1600, 900)
    pixels, depths = found.project(cluster)
    low, high = np.percentile(pixels[:, 1], [1, 99])
    assert high - low == pytest.approx(0.8 * 900, rel=0.06)
    assert (low + high) / 2 == pytest.approx(450, abs=20)
    assert (depths > 0).all()


def test_a_wall_before_the_core_is_looked_over():
    rng = np.random.default_rng(3)
    cluster = rng.uniform(-1, 1, (3000, 3)) + np.array([0, 0, 1])
    wall = np.c_[rng.uniform(-4, 4, 300), rng.uniform(-2.6, -2.4, 300), rng.uniform(0, 2.5, 300)]
    points = np.concatenate([cluster, wall])
    view = frame_core(make_default_viewpoint(), points)
    camera = view.fit_camera(1600, 900)
    (walls, near), (pixels, depths) = camera.project(wall), camera.project(cluster)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    before = ((walls > low) & (walls < high)).all(axis=1) & (near < 0.9 * depths.min())
    assert before.mean() < 0.25
    straight = np.r_[0.0, np.cos(0.25), -np.sin(0.25)]
    assert view.forward @ straight < 0.98, "from the front the wall would hide half"


def test_a_thing_behind_a_wall_is_looked_at_from_where_the_wall_is_not():
    rng = np.random.default_rng(4)
    car = rng.uniform(-1, 1, (500, 3)) * [1, 2, 0.7] + np.array([0, 0, 0.7])
    wall = np.c_[rng.uniform(-30, 30, 9000), rng.uniform(-3.2, -3.0, 9000), rng.uniform(0, 12, 9000)]
    areas = np.full(9500, 0.15)
    plain = frame_thing(make_default_viewpoint(), car, car, areas[:500])
    assert plain.forward[1] > 0.9, "roughly as before where nothing is in the way"
    found = frame_thing(make_default_viewpoint(), car, np.concatenate([car, wall]), areas)
    to_car = car - found.position
    crossing = found.position + to_car * ((-3.1 - found.position[1]) / to_car[:, 1:2])
    assert found.position[1] > -3.1 or (crossing[:, 2] > 12).mean() > 0.8, "in front of the wall, or above it"
    pixels, depths = found.fit_camera(1600, 900).project(car)
    assert (depths > 0).all()
    assert ((pixels > 0) & (pixels < (1600, 900))).all()


def test_the_first_view_of_a_street_is_not_inside_its_splats():
    means = procedural_street(0.5).gaussians.means
    view = frame_scene(means)
    assert np.linalg.norm(means - view.position, axis=1).min() > 2.0
    assert view.position[2] > 1.0
