"""The largest contributor of a pixel against all of its blending weights."""

from __future__ import annotations

import numpy as np
import pytest
from little_scenes import random_splats, small_camera

from instdrive_core.rasterize.kernels.blend_weights import compute_blend_weights
from instdrive_core.rasterize.kernels.top_contributors import find_top_contributors


@pytest.mark.parametrize("min_alpha", [0.0, 0.5, 0.9])
def test_it_is_the_largest_blending_weight_of_pixels_that_hide_enough(min_alpha: float) -> None:
    camera = small_camera(90, 70)
    splats = random_splats(camera, 600, 0, seed=1).arrays()[:4]
    pixels = np.random.default_rng(0).permutation(90 * 70)[:3000]
    top = find_top_contributors(*splats, camera, pixels, min_alpha)
    weights = compute_blend_weights(*splats, camera, pixels)
    shown = 0
    for pixel, found in enumerate(top.tolist()):
        entries = slice(weights.indptr[pixel], weights.indptr[pixel + 1])
        rows, values = weights.rows[entries], weights.weights[entries]
        if found < 0:
            assert values.sum() < min_alpha + 1e-5 or not len(rows)
            continue
        shown += 1
        assert values.sum() > min_alpha - 1e-5
        assert values[rows == found].max() > values.max() - 1e-6
    assert shown > 500
    assert (shown < 3000) == (min_alpha > 0)


def test_a_pixel_outside_the_image_is_refused() -> None:
    camera = small_camera()
    splats = random_splats(camera, 10, 0, seed=2).arrays()[:4]
    with pytest.raises(ValueError, match="leave the"):
        find_top_contributors(*splats, camera, np.array([camera.width * camera.height]), 0.5)
