"""Splats that one photo shows close the surface for other photos, too."""

import numpy as np
import pytest

from instdrive_core.edits.holes.behind.surface_splats import STEEPEST, lay_splats
from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.scene.camera import Camera, look_at

CAMERA = Camera(100.0, 100.0, 40.0, 30.0, 80, 60, look_at(np.array([1.0, 2.0, 3.0]), np.array([1.0, 9.0, 3.0])))


def lay_plane(slope):
    """The splats of a wall 10 m away, whose inverse depth grows by `slope` (1/m) from one large pixel to the next."""
    part = np.zeros((15, 20), bool)
    part[3:12, 4:16] = True
    inverse = np.tile(0.1 + slope * (np.arange(20) - 9.5), (15, 1))
    inverse[~part] = 1000.0
    offsets = np.argwhere(np.ones((4, 4), bool))
    pixels = (4 * np.argwhere(part)[:, None] + offsets).reshape(-1, 2)
    inside = (np.abs(pixels - [29.5, 39.5]) < [14, 20]).all(axis=1)
    return pixels, inside, lay_splats(CAMERA, pixels, inverse, part)


def covariances(quats, log_scales):
    axes = matrix_from_quaternion(quats.astype(np.float64)) * np.exp(log_scales.astype(np.float64))[:, None]
    return axes @ axes.transpose(0, 2, 1)


@pytest.mark.parametrize("slope", [0.0, 0.002])
def test_means_lie_on_the_surface_and_nothing_around_it_counts(slope):
    pixels, _, (means, _, _) = lay_plane(slope)
    places, depths = CAMERA.project(means.astype(np.float64))
    np.testing.assert_allclose(places, pixels[:, ::-1] + 0.5, atol=1e-3)
    assert depths.min() > 5
    assert depths.max() < 15


def test_a_wall_across_the_view_has_flat_round_splats():
    _, inside, (_, _, scales) = lay_plane(0.0)
    widths = np.sort(np.exp(scales[inside]), axis=1)
    np.testing.assert_allclose(widths, np.tile([0.012, 0.06, 0.06], (inside.sum(), 1)), rtol=1e-3)


def test_along_a_slanted_wall_splats_reach_the_next_ones():
    pixels, inside, (means, quats, scales) = lay_plane(0.002)
    grid = {tuple(pixel): row for row, pixel in enumerate(pixels.tolist())}
    rows = [row for row in np.flatnonzero(inside) if (pixels[row][0], pixels[row][1] + 1) in grid]
    steps = np.array([means[grid[pixels[row][0], pixels[row][1] + 1]] - means[row] for row in rows], np.float64)
    assert np.linalg.norm(steps, axis=1).mean() > 0.11, "wider apart than a pixel is wide"
    away = np.einsum("ki,kij,kj->k", steps, np.linalg.inv(covariances(quats, scales)[rows]), steps)
    np.testing.assert_allclose(np.sqrt(away), 1 / 0.6, rtol=0.1)


def test_a_step_in_depth_makes_no_curtain():
    _, _, (means, _, scales) = lay_plane(0.0095)
    depths = CAMERA.project(means.astype(np.float64))[1]
    assert (np.exp(scales).max(axis=1) <= 0.6 * 1.2 * np.hypot(STEEPEST, 1) * depths / 100).all()
