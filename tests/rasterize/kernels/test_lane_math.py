"""Functions of sixteen numbers at once, against numpy."""

from __future__ import annotations

import numba
import numpy as np

from instdrive_core.rasterize.kernels.lane_math import (
    exponentiate,
    round_down,
    round_to_even,
    round_up,
    take_logarithm,
    take_root,
)
from instdrive_core.rasterize.kernels.simd import load, store


@numba.njit(error_model="numpy")
def _apply_all(values, out):
    for at in range(np.uint64(0), np.uint64(len(values)), np.uint64(16)):
        x = load(values, at)
        results = (
            exponentiate(x),
            round_down(x),
            round_up(x),
            round_to_even(x),
            take_root(x * x),
            take_logarithm(x * x),
        )
        for k in range(6):
            store(out[k], at, results[k])


def test_they_are_numpys_to_a_few_units_in_the_last_place() -> None:
    values = np.concatenate([np.linspace(-80, 80, 3001), [0.5, 1.5, -2.5, 1e-3, 15.9, 16, 1]]).astype(np.float32)
    values = np.concatenate([values, np.ones(-len(values) % 16, np.float32)])
    values[values == 0] = 1
    out = np.zeros((6, len(values)), np.float32)
    _apply_all(values, out)
    np.testing.assert_allclose(out[0], np.exp(values.astype(np.float64)), rtol=3e-7)
    for found, expected in zip(out[1:4], (np.floor(values), np.ceil(values), np.rint(values)), strict=True):
        np.testing.assert_array_equal(found, expected)
    np.testing.assert_allclose(out[4], np.abs(values), rtol=1e-7)
    np.testing.assert_allclose(out[5], np.log((values * values).astype(np.float64)), rtol=3e-7, atol=1e-7)


def test_exponentials_of_what_is_too_large_or_no_number_are_numbers() -> None:
    values, out = np.ones(16, np.float32), np.zeros((6, 16), np.float32)
    values[:4] = [np.nan, np.inf, -np.inf, 1e30]
    _apply_all(values, out)
    np.testing.assert_allclose(out[0, :4], np.exp([-87, 88, -87, 88]), rtol=1e-6)
