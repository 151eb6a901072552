"""Which splats a draft keeps."""

import numpy as np
import pytest
from little_scenes import random_splats, small_camera

from instdrive_core.maths.workspace import Workspace
from instdrive_core.rasterize.importance import select_most_important
from instdrive_core.rasterize.kernels.project import project
from instdrive_core.rasterize.kernels.settings import DEFAULT_SETTINGS


def areas_of(splats):
    logs = np.sort(splats.log_scales, axis=1)
    return np.exp(logs[:, 1] + logs[:, 2])


def kept(splats, camera, budget, workspace=None):
    opacities = splats.opacities.astype(np.float32)
    arrays = splats.means, areas_of(splats).astype(np.float32), opacities
    return select_most_important(*arrays, camera, budget, DEFAULT_SETTINGS, workspace or Workspace())


@pytest.mark.parametrize("budget", [100, 1000, 3000])
def test_about_as_many_as_wanted_are_kept_and_none_matters_less_than_one_left_out(budget):
    camera = small_camera(300, 200)
    splats = random_splats(camera, 5000, 3, seed=4)
    taken = kept(splats, camera, budget)
    rows = np.flatnonzero(taken)
    assert 0.8 * budget <= len(rows) <= budget
    np.testing.assert_array_equal(taken[rows], splats.opacities[rows].astype(np.float32))
    pixels, depth = camera.project(splats.means)
    importance = splats.opacities * (camera.fx * camera.fy * areas_of(splats) / depth**2 + DEFAULT_SETTINGS.low_pass)
    seen = (depth > DEFAULT_SETTINGS.near) & (np.abs(pixels - [150, 100]) < [150, 100]).all(axis=1)
    left_out = seen & (taken == 0) & (splats.opacities >= DEFAULT_SETTINGS.min_alpha)
    assert importance[left_out].max() < importance[rows].min() * 2 ** (1 / 8) * 1.001


def test_where_all_fit_none_in_the_view_is_left_out():
    camera = small_camera(120, 80)
    splats = random_splats(camera, 2000, 3, seed=5)
    taken = kept(splats, camera, 2000)
    visible = project(*splats.arrays()[:4], camera, DEFAULT_SETTINGS).rows
    lost = np.setdiff1d(visible, np.flatnonzero(taken))
    assert len(lost) < 0.02 * len(visible), "long splats that only reach in from the side"


def test_no_splats_and_no_budget():
    camera = small_camera()
    assert len(kept(random_splats(camera, 0, 3, seed=0), camera, 100)) == 0
    few = kept(random_splats(camera, 500, 3, seed=1), camera, 0)
    assert (few > 0).sum() <= 500
