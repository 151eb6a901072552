"""Pieces of ground: what goes on along the lane goes on in a hole."""

from dataclasses import replace

import numpy as np

from instdrive_core.edits.holes.fill_plan import GROUND_PIECES
from instdrive_core.edits.holes.inpainting import choose_source_cells, continue_lines, profile_lines


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


def test_a_kerb_goes_on_where_only_its_height_far_away_is_known() -> None:
    """Other cars hide the pavement so far before and behind the hole that its colours there say nothing."""
    rng = np.random.default_rng(0)
    pavement = np.arange(30) >= 18
    color = np.where(pavement, 0.5, 0.3) + 0.02 * rng.standard_normal((120, 30))
    height = np.where(pavement, 0.12, 0.0) + 0.03 * rng.standard_normal((120, 30))
    hole, known = np.zeros((120, 30), bool), np.ones((120, 30), bool)
    hole[45:75, 12:] = True
    known[14:106, 12:] = False
    values = np.dstack([np.repeat(color[..., None], 3, axis=2), 2 * height])
    profile = profile_lines(height, known, 20)
    wrong = []
    for guide in (profile, None):
        sources = choose_source_cells(values, known, hole, np.random.default_rng(0), GROUND_PIECES, guide)
        assert sources is not None
        wrong.append(float(np.mean(np.abs(color[tuple(sources[hole].T)] - color[hole]) > 0.1)))
    assert wrong[0] <= 0.05
    assert wrong[1] > 0.5


def test_small_pieces_are_taken_where_only_they_are_of_what_belongs_there() -> None:
    """A known strip of pavement is narrower than the largest pieces."""
    rng = np.random.default_rng(0)
    pavement = np.broadcast_to(np.arange(40) >= 20, (60, 40))
    height = np.where(pavement, 0.12, 0.0)
    color = np.where(pavement, 0.6, 0.3) + 0.02 * rng.standard_normal((60, 40))
    hole, known = np.zeros((60, 40), bool), np.zeros((60, 40), bool)
    hole[20:40, 10:30] = True
    known[:, :20], known[45:, 25:29] = True, True
    values = np.repeat(color[..., None], 3, axis=2)
    right = []
    for config in (GROUND_PIECES, replace(GROUND_PIECES, told_share=0.0)):
        sources = choose_source_cells(values, known & ~hole, hole, np.random.default_rng(0), config, height)
        assert sources is not None
        paved = hole & pavement
        right.append(np.mean(np.abs(color[tuple(sources[paved].T)] - color[paved]) < 0.1))
    assert right[0] > 0.4
    assert right[1] == 0


def test_lines_without_known_cells_lie_between_their_neighbours() -> None:
    values = np.repeat(np.arange(5.0)[None] ** 2, 8, axis=0)
    known = np.ones((8, 5), bool)
    known[:, 2] = False
    assert np.allclose(profile_lines(values, known, 3.0), [0, 1, 5, 9, 16])
    assert not profile_lines(values, np.zeros_like(known), 3.0).any()


def test_lines_under_what_stands_lowest_are_no_slope_up_to_the_kerb():
    heights = np.tile([0.0, 0, 9, 9, 9, 9, 9, 0.15, 0.15], (6, 1))
    known = np.broadcast_to(heights[0] < 1, heights.shape)
    lowest = np.array([0, 0, 0, 1, 1, 0, 0, 0, 1], bool)
    told = profile_lines(heights, known, 3.0, lowest)
    np.testing.assert_allclose(told[2], [0, 0, 0, 0, 0, 0.15, 0.15, 0.15, 0.15])
    mirrored = profile_lines(heights[:, ::-1], known[:, ::-1], 3.0, lowest[::-1])
    np.testing.assert_allclose(mirrored, told[:, ::-1])


def test_a_mark_at_the_edge_of_what_is_known_is_not_strewn_beside_it() -> None:
    """Cars are parked all along the kerb: of the strip where they stand nothing is known but its line."""
    rng = np.random.default_rng(2)
    color = np.full((60, 30), 0.5) + 0.02 * rng.standard_normal((60, 30))
    mark = np.zeros((60, 30), bool)
    mark[rng.random(60) < 0.7, 17] = True  # worn
    color[mark] = 0.9
    known = np.broadcast_to(np.arange(30) < 18, (60, 30)).copy()
    hole = np.zeros((60, 30), bool)
    hole[20:40, 16:] = True
    bright = []
    for bound in (mark, None):
        sources = choose_source_cells(
            np.repeat(color[..., None], 3, axis=2), known, hole, np.random.default_rng(0), GROUND_PIECES, bound=bound
        )
        assert sources is not None
        filled = np.zeros(hole.shape, bool)
        filled[hole] = color[tuple(sources[hole].T)] > 0.7
        bright.append(filled[20:40, 19:].mean())
    assert bright[0] == 0
    assert bright[1] > 0.05
