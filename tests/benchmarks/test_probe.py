"""Peak rate and evaluations that a frame needs."""

from __future__ import annotations

import numba
import numpy as np
from little_scenes import plain_splats, random_splats, small_camera

from benchmarks import probe
from benchmarks.workload import Workload
from instdrive_core.rasterize.kernels.bin import TILE, bin_splats
from instdrive_core.rasterize.kernels.project import Projection, project
from instdrive_core.rasterize.kernels.settings import DEFAULT_SETTINGS
from instdrive_core.scene.camera import Camera


def _projected(splats, camera: Camera) -> Projection:
    means, quats, log_scales, opacities, _ = splats.arrays()
    return project(means, quats, log_scales, opacities, camera, DEFAULT_SETTINGS)


def test_the_peak_is_a_rate_that_grows_with_the_threads() -> None:
    rate = probe.measure_pixel_rate(0.1)
    assert 1e7 < rate < 1e11 * numba.get_num_threads()


def test_the_probe_does_the_work_that_it_counts() -> None:
    constants, sums = DEFAULT_SETTINGS.to_row(), np.zeros((2, TILE * TILE * 12 + TILE), np.float32)
    probe._blend_rounds(probe._covering_splats(), 3, constants, sums)
    x = np.arange(TILE) - 7.5
    alpha = 2.0 ** (8 * (-0.8 - 1e-4 * x * x))
    covered = 1 - (1 - alpha) ** probe._SPLATS  # of each column
    expected = np.broadcast_to(3 * 0.5 * covered, (2, TILE, 12, TILE))
    np.testing.assert_allclose(sums[:, :-TILE].reshape(2, TILE, 12, TILE), expected, rtol=1e-3)


def test_fragments_are_the_pixels_whose_alpha_is_drawn() -> None:
    camera = small_camera(90, 70)
    projection = _projected(random_splats(camera, 60, 0, seed=3), camera)
    y, x = np.mgrid[:70, :90] + 0.5
    expected = 0
    for px, py, xx, xy, yy, opacity, *_ in projection.splats.astype(np.float64):
        dx, dy = x - px, y - py
        expected += int((opacity * np.exp(-0.5 * (xx * dx * dx + 2 * xy * dx * dy + yy * dy * dy)) >= 1 / 255).sum())
    assert abs(probe.count_visible_fragments(projection, 90, 70) - expected) <= 2  # pixels on the very edge


def test_evaluations_are_rows_of_boxes_in_tile_columns() -> None:
    camera = small_camera(90, 70)
    projection = _projected(plain_splats(camera, [[40.0, 30.0]], [4.0], 3, 0.9), camera)
    reach = np.sqrt(projection.splats[0, 7] * projection.covariances[0, [0, 2]])
    first = np.ceil(projection.splats[0, :2] - reach - 0.5)
    last = np.floor(projection.splats[0, :2] + reach - 0.5)
    columns = last[0] // TILE - first[0] // TILE + 1
    assert probe.count_tight_evaluations(projection, 90, 70) == (last[1] - first[1] + 1) * columns * TILE


def test_a_workload_is_projected_with_its_camera() -> None:
    camera = small_camera(90, 70)
    splats = random_splats(camera, 100, 11, seed=5)
    workload = Workload(*splats.arrays(), cameras=(camera,))
    expected = probe.count_tight_evaluations(_projected(splats, camera), 90, 70)
    assert probe.count_evaluations(workload, camera) == expected > 0


def test_bounds_hold_each_other() -> None:
    camera = small_camera(90, 70)
    projection = _projected(random_splats(camera, 300, 0, seed=5), camera)
    spans = bin_splats(projection, 90, 70).spans.astype(np.int64)
    drawn = int(TILE * (spans[:, 1] - spans[:, 0]).sum())
    assert probe.count_visible_fragments(projection, 90, 70) < drawn < probe.count_tight_evaluations(projection, 90, 70)


def test_nothing_in_view_needs_nothing() -> None:
    camera = small_camera()
    projection = _projected(plain_splats(camera, [[-400, 18]], [4.0], 3, 0.9), camera)
    assert probe.count_tight_evaluations(projection, camera.width, camera.height) == 0
    assert probe.count_visible_fragments(projection, camera.width, camera.height) == 0
