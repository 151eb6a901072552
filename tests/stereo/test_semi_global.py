"""Planes are chosen by costs, and by neighbours where costs say nothing."""

import numpy as np
import pytest

from instdrive_core.stereo.semi_global import match_planes

EVEN = np.full((20, 30), 100, np.float32)


def costs_of(planes, count=16):
    """Costs that rise with the distance from each pixel's plane, at most 255."""
    away = np.abs(np.arange(count) - np.asarray(planes, float)[..., None])
    return np.minimum(away * 60, 255).astype(np.uint8)


def test_clear_costs_decide():
    planes = np.tile(np.linspace(2, 12, 30), (20, 1))
    np.testing.assert_allclose(match_planes(costs_of(planes), EVEN), planes, atol=0.3)


def test_fractions_of_planes_are_told():
    assert match_planes(costs_of(np.full((20, 30), 6.3)), EVEN)[10, 15] == pytest.approx(6.3, abs=0.15)


def test_gaps_are_closed_from_all_sides():
    costs = costs_of(np.full((20, 30), 7))
    costs[6:14, 10:20] = 128
    np.testing.assert_allclose(match_planes(costs, EVEN), 7, atol=0.01)


def test_single_errors_do_not_stay():
    planes = np.full((20, 30), 7)
    planes[10, 15] = 12
    costs = costs_of(planes)
    costs[10, 15] //= 3
    assert match_planes(costs, EVEN)[10, 15] == pytest.approx(7, abs=0.5)


def test_depths_jump_where_colours_do():
    planes = np.where(np.arange(30) < 15, 3, 12) * np.ones((20, 1))
    costs = costs_of(planes)
    costs[:, 10:20] = 128
    grey = EVEN.copy()
    grey[:, 13:] = 200
    found = match_planes(costs, grey)
    np.testing.assert_allclose(found[:, :13], 3, atol=0.5)
    np.testing.assert_allclose(found[:, 13:], 12, atol=0.5)
