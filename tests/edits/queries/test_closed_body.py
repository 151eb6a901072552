"""The body around a symmetric thing, and its skin."""

import numpy as np
import pytest

from instdrive_core.edits.queries.closed_body import STEP, find_body
from instdrive_core.edits.queries.symmetry import Symmetry

PLANE = Symmetry((3.0, 1.0), 0.6, 1.0)
AXES = np.array([[np.cos(0.6), np.sin(0.6), 0.0], [-np.sin(0.6), np.cos(0.6), 0.0], [0.0, 0.0, 1.0]])
MIDDLE = np.array([3.0, 1.0, 0.7])
HALF = np.array([2.0, 0.9, 0.7])


def box_points(count=6000, seed=0):
    """The right side, front, back and roof of a box that stands on the ground."""
    points = np.random.default_rng(seed).uniform(-1, 1, (count, 3))
    face = np.arange(count) % 4
    for number, (axis, sign) in enumerate([(1, -1), (0, 1), (0, -1), (2, 1)]):
        points[face == number, axis] = sign
    return place(points * HALF)


def place(points):
    return points @ AXES + MIDDLE


def back(points):
    return (points - MIDDLE) @ AXES.T


@pytest.fixture(scope="module")
def body():
    return find_body(box_points(), PLANE)


def test_inside_is_told_from_outside_on_both_sides(body):
    inner = place(np.random.default_rng(1).uniform(-0.85, 0.85, (500, 3)) * HALF)
    assert np.quantile(body.measure_outside(inner), 0.97) < 0, "only the edges are rounded"
    outer = place(np.array([[0, 1.4, 0], [0, -1.4, 0], [0, 0, 1.2], [2.6, 0, 0], [-2.6, 0, 0.0]]))
    np.testing.assert_allclose(body.measure_outside(outer), [0.5, 0.5, 0.5, 0.6, 0.6], atol=0.1)


def test_the_skin_lies_inside_and_covers_the_whole_box(body):
    skin = body.build_skin(0.1)
    local = back(skin.places)
    assert (np.abs(local) <= HALF - 0.05).all()
    # Each place of the inner box has a patch nearby, the underside and the side that nobody saw included.
    asked = np.random.default_rng(2).uniform(-1, 1, (600, 3))
    face = np.arange(600) % 3
    asked[np.arange(600), face] = np.sign(asked[np.arange(600), face])
    asked *= HALF - 0.12
    apart = np.linalg.norm(asked[:, None] - local, axis=2).min(axis=1)
    assert np.quantile(apart, 0.95) < 1.5 * STEP
    sizes = 4 * np.linalg.norm(np.cross(skin.along, skin.around), axis=1)
    whole = 8 * ((HALF - 0.1) * np.roll(HALF - 0.1, 1)).sum()
    assert sizes.sum() == pytest.approx(whole, rel=0.15)


def test_mirrors_and_shadows_do_not_widen_it(body):
    rng = np.random.default_rng(3)
    mirror = place(rng.uniform(-0.1, 0.1, (60, 3)) + np.array([0.8, -1.1, 0.2]))
    shadow = place(np.c_[rng.uniform(2.2, 3.2, 300), rng.uniform(-1, 1, 300), np.full(300, -0.68)])
    other = find_body(np.concatenate([box_points(), mirror, shadow]), PLANE)
    beside = place(np.array([[0.8, -1.2, 0.2], [2.6, 0.0, -0.6]]))
    np.testing.assert_allclose(other.measure_outside(beside), body.measure_outside(beside), atol=0.1)


def test_what_is_too_small_or_empty_has_no_skin():
    for points in (np.zeros((0, 3)), box_points(30)):
        body = find_body(points, PLANE)
        assert len(body.build_skin(0.1)) == 0
        assert np.isinf(body.measure_outside(np.zeros((2, 3)))).all()
    assert len(find_body(box_points() * [1, 1, 0.2], PLANE).build_skin(0.1)) == 0
