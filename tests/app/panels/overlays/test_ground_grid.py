"""The grid's spacing and lines."""

from dataclasses import replace

import numpy as np
import pytest

from instdrive_app.panels.overlays.ground_grid import CELLS, choose_grid_spacing, list_grid_lines
from instdrive_app.state import make_default_viewpoint


@pytest.mark.parametrize(
    ("distance", "spacing"), [(0.3, 0.02), (5.0, 0.5), (10.0, 1.0), (40.0, 2.0), (50.0, 5.0), (900.0, 100.0)]
)
def test_spacing_is_a_round_figure_that_follows_the_view(distance, spacing):
    assert choose_grid_spacing(replace(make_default_viewpoint(), pivot_distance=distance)) == pytest.approx(spacing)


def test_lines_lie_level_around_the_middle():
    lines = list_grid_lines(np.array([10.0, -5.0, 1.5]), 2.0)
    ends = np.array([[start, end] for start, end, _ in lines])
    assert len(lines) == 2 * (2 * CELLS + 1)
    assert (ends[..., 2] == 1.5).all()
    assert np.allclose(ends.mean(axis=(0, 1)), [10.0, -5.0, 1.5])
    assert np.allclose(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), 4.0 * CELLS)
    assert sum(is_strong for _, _, is_strong in lines) == 10
