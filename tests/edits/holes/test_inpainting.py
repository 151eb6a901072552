"""Pieces of ground: what goes on along the lane goes on in a hole."""

from dataclasses import replace

import numpy as np

from instdrive_core.edits.holes.fill_plan import GROUND_PIECES
from instdrive_core.edits.holes.inpainting import choose_source_cells, continue_lines


def _make_kerb() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Road and, from line 18 on, pavement. Other cars hide what is right before and behind the hole but road."""
    rng = np.random.default_rng(1)
    color = np.where(np.arange(30) >= 18, 0.7, 0.3)
    values = np.repeat((color + 0.02 * rng.standard_normal((60, 30)))[..., None], 3, axis=2)
    hole = np.zeros((60, 30), bool)
    hole[18:42, 12:] = True
    known = np.ones((60, 30), bool)
    known[12:48, 12:] = False
    return values, known, hole


def test_a_kerb_goes_on_where_it_is_seen_before_and_behind_the_hole() -> None:
    values, known, hole = _make_kerb()
    wrong = []
    for penalty in (GROUND_PIECES.line_penalty, 0.0):
        config = replace(GROUND_PIECES, line_penalty=penalty)
        sources = choose_source_cells(values, known, hole, np.random.default_rng(0), config)
        assert sources is not None
        filled = values[tuple(sources[hole].T)][:, 0]
        wrong.append(float(np.mean(np.abs(filled - values[hole][:, 0]) > 0.2)))
    assert wrong[0] <= 0.05
    assert wrong[0] < wrong[1] / 2


def test_lines_say_nothing_where_nothing_near_is_known() -> None:
    values = np.ones((80, 2, 1))
    known = np.zeros((80, 2), bool)
    known[:4, 0] = True
    lines = continue_lines(values, known, 10.0)
    assert np.allclose(lines[:10, 0], 1)
    assert np.isnan(lines[40:, 0]).all()
    assert np.isnan(lines[:, 1]).all()


def test_nearer_cells_say_more() -> None:
    values = np.zeros((30, 1, 1))
    values[25:] = 1
    known = np.ones((30, 1), bool)
    known[5:25] = False
    lines = continue_lines(values, known, 5.0)[:, 0, 0]
    assert lines[6] < 0.1 < 0.9 < lines[23]
