"""Ray drop: a panel that loses rays is found, the grid has what was lost, and draws repeat."""

import numpy as np
from test_cast_rays import FAR_WALL, NEAR_PANEL, PANEL, WALL, make_scene

from instdrive_core.datasets.clip import Sweep, SweepPoints
from instdrive_core.sweeps.cast import RayCaster
from instdrive_core.sweeps.drops import learn_drop
from instdrive_core.sweeps.pattern import AMID
from instdrive_core.sweeps.rig import Rig

STILL = Rig(np.array([0.0]), np.eye(4)[None])
ACROSS, UP = np.meshgrid(np.arange(-0.2, 0.2, 0.004), np.arange(-0.2, 0.2, 0.004))
AIMS = np.stack([np.ones(ACROSS.size), ACROSS.ravel(), UP.ravel()], axis=1)


def measure(number, lost, panel_from=2):
    """A sweep; the panel stands in the way from the sweep `panel_from` on and then loses a share of the rays."""
    at_panel = (np.abs(AIMS[:, 1:]) * 12 < 1).all(axis=1) & (number >= panel_from)
    points = AIMS * np.where(at_panel, 12, 20)[:, None]
    gone = at_panel & (np.random.default_rng(number).random(len(AIMS)) < lost)
    points = points[~gone].astype(np.float32)
    return Sweep(number, 0.0, lambda: SweepPoints(points, points[:, 0] * 0 + 1, np.zeros(len(points), np.uint8), None))


def test_a_surface_that_loses_rays_is_found_and_its_neighbour_is_not():
    scene = make_scene([FAR_WALL, NEAR_PANEL], [WALL, PANEL])
    # The panel is in the scene; four sweeps show all rays, as if it had returned them, and four have lost 60 %.
    sweeps = [measure(number, 0.6, panel_from=4) for number in range(8)]
    caster = RayCaster(scene)
    drop = learn_drop(caster, STILL, sweeps, AMID)
    assert len(drop.grid.directions) > 0.97 * len(AIMS)
    returns = caster.cast(drop.grid.aim(STILL, 0.0))
    aside = np.abs(12 * drop.grid.directions[:, 1:] / drop.grid.directions[:, :1]).max(axis=1)
    at_panel, beside = aside < 0.7, aside > 2  # between them the panel is thin
    shares = drop.find_shares(returns.rows, returns.ranges)
    assert 0.2 < np.median(shares[at_panel]) < 0.4, "half of the sweeps lost 60 %"
    assert np.median(shares[beside]) < 0.03
    kept = drop.draw_kept(returns, 7)
    assert abs(kept[at_panel].mean() - (1 - shares[at_panel].mean())) < 0.05
    np.testing.assert_array_equal(kept, drop.draw_kept(returns, 7))
    assert (kept != drop.draw_kept(returns, 8)).any()


def test_a_sensor_that_loses_nothing_loses_hardly_anything():
    scene = make_scene([FAR_WALL], [WALL])
    drop = learn_drop(RayCaster(scene), STILL, [measure(number, 0.0, 99) for number in range(4)], AMID)
    returns = RayCaster(scene).cast(drop.grid.aim(STILL, 0.0))
    assert drop.draw_kept(returns, 1).mean() > 0.97
    assert (drop.of_rows(np.arange(5)).factors == drop.factors[:5]).all()
