"""Offsets of splats from their surfaces: learned from sweeps, right for rays that no sweep had."""

import numpy as np
import pytest
from test_cast_rays import FAR_WALL, NEAR_PANEL, PANEL, WALL, fan, make_scene

from instdrive_core.datasets.clip import Sweep, SweepPoints
from instdrive_core.sweeps.cast import RayCaster
from instdrive_core.sweeps.offsets import choose_evenly, learn_offsets
from instdrive_core.sweeps.pattern import AMID
from instdrive_core.sweeps.rig import Rig

STILL = Rig(np.array([0.0]), np.eye(4)[None])


def measure(wall, seed):
    """A sweep of a wall at x = `wall`, with 1 cm of noise."""
    rng = np.random.default_rng(seed)
    sideways = rng.uniform(-2.5, 2.5, (3000, 2))
    points = np.c_[np.full(3000, wall), sideways] * (1 + rng.normal(0, 0.01 / wall, (3000, 1)))
    measured = SweepPoints(points.astype(np.float32), np.ones(3000, np.float32), np.zeros(3000, np.uint8), None)
    return Sweep(seed, 0.0, lambda: measured)


def test_splats_before_their_surface_return_where_sweeps_met_it():
    scene = make_scene([FAR_WALL], [WALL], alpha=-1.0)  # the splats are at 20 m, the wall is at 20.1
    caster, rays = RayCaster(scene), fan(spread=0.1)
    offsets = learn_offsets(caster, STILL, [measure(20.1, 1), measure(20.1, 2)], AMID)
    before = caster.cast(rays).ranges * rays.directions[:, 0]
    after = RayCaster(scene, offsets=offsets).cast(rays)
    np.testing.assert_allclose(before, 20, atol=0.02)
    np.testing.assert_allclose(after.ranges * rays.directions[:, 0], 20.1, atol=0.03)
    unseen = np.abs(scene.gaussians.means[:, 1:]).max(axis=1) > 4
    assert unseen.any()
    assert not offsets[unseen].any()


def test_what_stands_behind_or_before_the_measured_point_learns_nothing():
    scene = make_scene([FAR_WALL, NEAR_PANEL], [WALL, PANEL])
    offsets = learn_offsets(RayCaster(scene), STILL, [measure(15.0, 1)], AMID)
    assert not offsets.any()


@pytest.mark.parametrize(("count", "expected"), [(0, []), (2, [0, 1]), (9, [0, 3, 5, 8])])
def test_sweeps_are_chosen_over_the_whole_drive(count, expected):
    assert [sweep.index for sweep in choose_evenly([measure(9.0, number) for number in range(count)], 4)] == expected
