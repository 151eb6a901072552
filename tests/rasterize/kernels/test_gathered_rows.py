"""Training draws other rows at every step: nothing is compiled anew, and threads do not change a bit."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from little_scenes import Splats, random_splats, small_camera

from instdrive_core.rasterize.kernels import backward, blend, buffer_pool, project_backward
from instdrive_core.rasterize.render import render, render_backward

NAMES = ("means", "quats", "log_scales", "opacities", "channels", "means2d_abs", "visible")


def _drawn(splats: Splats, seed: int = 0) -> list[np.ndarray]:
    camera = small_camera(150, 100)
    raster = render(*splats.arrays(), camera)
    rng = np.random.default_rng(seed)
    grads = [rng.normal(size=array.shape) for array in (raster.image, raster.depth, raster.alpha)]
    gradients = render_backward(raster.context, *grads, 3)
    return [raster.image, raster.depth, raster.alpha, *(getattr(gradients, name) for name in NAMES)]


@pytest.fixture
def splats() -> Splats:
    return random_splats(small_camera(150, 100), 3000, 11, seed=4)


def test_any_number_of_rows_runs_the_same_kernels(splats: Splats) -> None:
    _drawn(splats)
    kernels = (blend._blend, backward._blend_backward, project_backward._project_backward)
    compiled = [len(kernel.signatures) for kernel in kernels]
    for count in (0, 20, 21, 2999):
        drawn = _drawn(Splats(*(array[:count] for array in splats.arrays())))
        assert drawn[3].shape == (count, 3)
        assert drawn[2].any() == (count > 0)
    assert [len(kernel.signatures) for kernel in kernels] == compiled


def test_rows_that_are_not_seen_change_nothing(splats: Splats) -> None:
    whole = _drawn(splats)
    seen = np.flatnonzero(whole[3 + NAMES.index("visible")])
    assert 0 < len(seen) < len(splats)
    gathered = _drawn(Splats(*(array[seen] for array in splats.arrays())))
    for left, right in zip(whole[:3], gathered[:3], strict=True):
        np.testing.assert_array_equal(left, right)
    for left, right in zip(whole[3:], gathered[3:], strict=True):
        np.testing.assert_array_equal(left[seen], right)


def test_the_number_of_threads_does_not_change_a_bit(splats: Splats) -> None:
    before = numba.get_num_threads()
    try:
        runs = []
        for threads in {1, 2, before}:
            numba.set_num_threads(min(threads, before))
            runs.append(_drawn(splats))
    finally:
        numba.set_num_threads(before)
    for other in runs[1:]:
        for left, right in zip(runs[0], other, strict=True):
            np.testing.assert_array_equal(left, right)


def test_spare_memory_is_used_again_but_never_by_two_at_once() -> None:
    with buffer_pool.borrow_floats(1000) as first, buffer_pool.borrow_floats(1000) as second:
        assert len(first) == len(second) == 1000
        assert not np.shares_memory(first, second)
        addresses = {first.ctypes.data, second.ctypes.data}
    with buffer_pool.borrow_floats(900) as third:
        assert len(third) == 900
        assert third.ctypes.data in addresses
