"""How well hidden ground is guessed, seen from above."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.hole_maps import HiddenGround, measure_fill
from instdrive_core.edits.holes.ground_grid import GroundGrid
from instdrive_core.edits.holes.ground_light import GroundLight
from instdrive_core.edits.holes.ground_map import GroundMap


def _make_street(under: float) -> HiddenGround:
    """Grey ground everywhere, and of brightness `under` in the shaded half of the hole."""
    shape = (60, 30)
    color = np.full((*shape, 3), 0.5)
    hole, lit = np.zeros(shape, bool), np.ones(shape, bool)
    hole[25:35, 10:20], lit[:30] = True, False
    truth = np.where((hole & ~lit)[..., None], under, color).astype(np.float32)
    grid = GroundGrid((0.0, 0.0), (0.0, 1.0), 0.2, shape, (0.0, 0.0, 0.0))
    nothing = np.zeros(shape, bool)
    ground = GroundMap(grid, np.ones(shape), color, np.zeros(shape), nothing, np.zeros(0, bool))
    return HiddenGround(ground, ~hole, hole, truth, lit, hole.any(axis=0))


def test_even_ground_is_guessed_right() -> None:
    psnr, blur, *_ = measure_fill(_make_street(0.5))
    assert psnr > 60
    assert blur < 1e-3


def test_the_error_lies_where_the_guess_is_wrong() -> None:
    psnr, blur, shade, _ = measure_fill(_make_street(0.3))
    assert psnr == pytest.approx(-10 * np.log10(0.04 / 2), abs=0.2)
    assert 0.05 < blur < 0.15
    assert shade > 0.99


def test_who_is_told_the_shade_lays_it() -> None:
    found = _make_street(0.3)
    light = GroundLight((~found.lit & found.hole).astype(float), np.full((*found.hole.shape, 3), 0.6))
    psnr, _, _, told = measure_fill(replace(found, light=light))
    assert told == 1
    assert psnr > measure_fill(found)[0] + 6
