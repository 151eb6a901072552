"""The editor draws in one thread while another loads or saves: kernels of two threads must not disturb each other."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numba
import numpy as np
from little_scenes import random_splats, small_camera

from instdrive_core.rasterize.preview import render_preview
from instdrive_core.rasterize.render import render, render_backward


def test_two_threads_get_what_one_gets() -> None:
    camera = small_camera(150, 100)
    scenes = [random_splats(camera, 800, 3, seed=seed) for seed in range(6)]

    def draw(splats) -> list[np.ndarray]:
        raster = render(*splats.arrays(), camera)
        gradients = render_backward(raster.context, raster.image, raster.depth, raster.alpha, 3)
        frame = render_preview(*splats.arrays(), camera)
        return [raster.image, gradients.means, gradients.opacities, frame.color, frame.winner]

    alone = [draw(splats) for splats in scenes]
    with ThreadPoolExecutor(3) as pool:
        together = list(pool.map(draw, scenes * 3))
    for k, drawn in enumerate(together):
        for left, right in zip(drawn, alone[k % 6], strict=True):
            np.testing.assert_array_equal(left, right)
    assert numba.threading_layer() in ("tbb", "omp")
