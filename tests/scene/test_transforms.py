"""Moves that are baked, and the homes that they start from."""

import numpy as np
from random_scene import random_gaussians

from instdrive_core.scene.transforms import (
    TransformPalette,
    copy_at_home,
    copy_transformed,
    find_away,
    move_entry,
    rebase_entry,
)


def test_what_was_moved_by_itself_is_away_and_has_a_home():
    gaussians = random_gaussians(np.random.default_rng(0), 6)
    palette = TransformPalette(6)
    turn, shift = np.c_[np.diag([-1.0, -1.0, 1.0]), np.zeros(3)], np.c_[np.eye(3), [1.0, 2.0, 3.0]]
    rows, turned = np.arange(6), palette.add_values(rebase_entry(turn)(palette.values[0]))
    moved = palette.add_values(move_entry(shift)(palette.values[turned]))
    palette.assign(rows, np.repeat([turned, moved], 3).astype(np.uint16))
    assert find_away(palette, rows).tolist() == 3 * [False] + 3 * [True], "a scene that is turned moves nothing away"
    home = copy_at_home(gaussians, palette, rows).means
    np.testing.assert_allclose(home, gaussians.means * [-1, -1, 1], atol=1e-6)
    shown = copy_transformed(gaussians, palette, rows).means
    np.testing.assert_allclose((shown - home)[3:], np.tile([1, 2, 3], (3, 1)), atol=1e-5)
