"""Filling a hole in a picture with pieces of itself: exemplar-based inpainting (Criminisi, Pérez & Toyama 2004).

The picture is the ground from above. Instead of colours the answer names, for each missing cell, the cell to copy.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numba
import numpy as np
from jaxtyping import Bool, Float64, Int64, Shaped
from numpy import ndarray
from numpy.lib.stride_tricks import sliding_window_view
from scipy import ndimage

_BATCH = 64
"""Pieces that are looked at together, those that may be best first."""
ON_LINE = 1
"""Cells across that what is bound to a line may shift: lines are seldom quite straight."""
MIN_TOLD = 0.02
"""Cells right there that what is known on a line must count like, to say what the line is like: one is enough that is
four times as far away as the reach, for what lies beside the line says less."""


@dataclass(frozen=True)
class ExemplarConfig:
    """How pieces are chosen."""

    windows: tuple[int, ...] = (7, 5, 3, 1)
    """Cells per side of a piece: the largest size of which there are enough is taken."""
    min_candidates: int = 30
    novelty_penalty: float = 1.0
    """Added per mean squared difference of what a piece brings from the likest filled cell that it is matched to: marks
    on the road and kerbs are continued, but not begun."""
    across_penalty: float = 3e-4
    """Added to the mean squared difference per squared cell that a piece comes from across the lane: kerbs, lane marks
    and ruts run along it."""
    along_penalty: float = 2e-5
    """Added to the mean squared difference per squared cell that a piece comes from along the lane."""
    reuse_penalty: float = 2e-3
    """Added for each time that a piece close to it was taken already: nothing is stamped all over the hole."""
    reuse_reach: int = 2
    """Cells along and across within which a piece is close to another."""
    line_penalty: float = 0.0
    """Added per mean squared difference of what a piece brings from what is known on the same line along the lane: a
    kerb goes on where it is seen before and behind the hole."""
    line_reach: float = 10.0
    """Cells along the lane over which known ones count less by e."""
    guide_penalty: float = 0.0
    """Added per mean squared difference of the guide where a piece comes from and where it goes: what belongs to the
    pavement is not copied onto the road."""
    guide_reach: float = 0.05
    """Difference of the guide up to which a piece is of what belongs there."""
    bound_penalty: float = 0.0
    """Added per share of what a piece brings that is bound to its line and would come to another: marks on the road are
    continued, but not strewn beside it."""
    told_share: float = 0.9
    """Pieces may be so large that for this share of what the smallest ones can fill there are such pieces."""
    variety: float = 0.1
    """Share by which costs are drawn larger, so that no piece is repeated for a tiny advantage."""


DEFAULT_CONFIG = ExemplarConfig()


def choose_source_cells(
    values: Float64[ndarray, "a b v"],
    known: Bool[ndarray, "a b"],
    hole: Bool[ndarray, "a b"],
    rng: np.random.Generator,
    config: ExemplarConfig = DEFAULT_CONFIG,
    guide: Float64[ndarray, "a b"] | None = None,
    extra: Float64[ndarray, "a b"] | None = None,
    bound: Bool[ndarray, "a b"] | None = None,
) -> Int64[ndarray, "a b 2"] | None:
    """For each cell of the hole the known cell to copy, -1 elsewhere; None where nothing is known.

    Axis 0 runs along the lane. Cells that are neither known nor of the hole are left out of comparisons. A `guide` says
    of every cell, known or not, what belongs there. Squared differences of `extra`, known everywhere, too, are added to
    what a piece costs. Cells that are `bound` belong to their lines along axis 0.
    """
    known = known & ~hole
    window = _cut_window(known, hole, config, guide)
    if window is None:
        return None
    pad = window // 2
    padded = np.pad(values, ((pad, pad), (pad, pad), (0, 0)))
    filled, todo = np.pad(known, pad), np.pad(hole, pad)
    middles = _find_whole_windows(known, window)
    candidates = _cut_pieces(padded, middles, window)
    guided = np.pad(np.zeros(hole.shape) if guide is None else guide, pad, mode="edge")
    added = np.pad(np.zeros(hole.shape) if extra is None else extra, pad, mode="edge")
    fixed = np.pad(np.zeros(hole.shape, bool) if bound is None else bound, pad)
    guides, extras, marks = (_cut_pieces(each, middles, window) for each in (guided, added, fixed))
    lines = continue_lines(values, known, config.line_reach) if config.line_penalty else np.full(values.shape, np.nan)
    lines = np.pad(lines, ((pad, pad), (pad, pad), (0, 0)), constant_values=np.nan)
    sources, uses = np.full((*hole.shape, 2), -1), np.zeros(len(middles))
    while todo.any():
        middle = _choose_next_middle(filled, todo, window)
        part = tuple(slice(each, each + window) for each in middle)
        there = filled[part]
        away = np.abs(middles - middle)
        least = config.across_penalty * away[:, 1] ** 2 + config.along_penalty * away[:, 0]
        least += config.reuse_penalty * uses
        if guide is not None:
            least += config.guide_penalty * ((guides[:, todo[part]] - guided[part][todo[part]]) ** 2).mean(axis=1)
        if extra is not None:
            least += ((extras[:, todo[part]] - added[part][todo[part]]) ** 2).mean(axis=1)
        if bound is not None:
            least += config.bound_penalty * marks[:, todo[part]].mean(axis=1) * (away[:, 1] > ON_LINE)
        scales = 1 + config.variety * rng.random(len(middles))
        if there.any():
            least += _measure_differences(candidates, padded[part], there)
            on_lines = lines[part][todo[part]]
            best = _find_best(candidates, _Wanted(todo[part], on_lines, padded[part][there]), least, scales, config)
        else:
            best = int(np.argmin(least * scales))
        uses += (np.abs(middles - middles[best]) <= config.reuse_reach).all(axis=1)
        fresh = np.argwhere(todo[part])
        places = fresh + middle
        padded[tuple(places.T)] = candidates[best][tuple(fresh.T)]
        sources[tuple((places - pad).T)] = fresh - pad + middles[best]
        filled[tuple(places.T)], todo[tuple(places.T)] = True, False
    return sources


def weigh_along(count: int, reach: float) -> Float64[ndarray, "a a"]:
    """What each of `count` cells counts for each other one on its line, where one `reach` cells farther counts less by
    e, and a cell right there 1."""
    places = np.arange(count)
    return np.exp(-np.abs(places[:, None] - places) / reach)


def continue_lines(
    values: Float64[ndarray, "a b v"], known: Bool[ndarray, "a b"], reach: float
) -> Float64[ndarray, "a b v"]:
    """Mean of what is known on each cell's line along axis 0, where a cell `reach` cells farther counts less by e.

    NaN where what is known counts less than a cell right there.
    """
    weights = weigh_along(len(values), reach)
    sums, total = np.einsum("ij,jbv->ibv", weights, np.where(known[..., None], values, 0)), weights @ known
    return np.where((total >= 1)[..., None], sums / np.maximum(total, 1)[..., None], np.nan)


def sum_lines(
    values: Float64[ndarray, "a b"], known: Bool[ndarray, "a b"], reach: float
) -> tuple[Float64[ndarray, "a b"], Float64[ndarray, "a b"]]:
    """Sum of what is known on each cell's line along axis 0, where a cell `reach` cells farther counts less by e, and
    what the known cells count."""
    weights = weigh_along(len(values), reach)
    return weights @ np.where(known, values, 0), weights @ known


def profile_lines(
    values: Float64[ndarray, "a b"],
    known: Bool[ndarray, "a b"],
    reach: float,
    lowest: Bool[ndarray, " b"] | None = None,
) -> Float64[ndarray, "a b"]:
    """What every cell's line along axis 0 is like: the mean of what is known on it, where a cell `reach` cells farther
    counts less by e. Lines on which nothing is known lie between those beside them; 0 where there are none at all.

    Of the lines that are `lowest` it is known that they are like the lower of what lies on either side, where nothing
    is known on them: what is between them and there, is like the other side.
    """
    sums, total = sum_lines(values, known, reach)
    profiles, places = np.zeros(values.shape), np.arange(values.shape[1])
    for profile, line_sums, line_total in zip(profiles, sums, total, strict=True):
        told = line_total >= MIN_TOLD
        if told.any():
            found = line_sums[told] / line_total[told]
            profile[:] = np.interp(places, places[told], found)
            if lowest is not None:
                _lower(profile, told, lowest)
    return profiles


def _lower(profile: Float64[ndarray, " b"], told: Bool[ndarray, " b"], lowest: Bool[ndarray, " b"]) -> None:
    """Write the lines on which nothing is known as `profile_lines` says, gap by gap between those that are told."""
    lines = np.flatnonzero(told)
    for left, right in pairwise(lines):
        low = left + 1 + np.flatnonzero(lowest[left + 1 : right])
        if len(low):
            profile[left + 1 : low[0]] = profile[left]
            profile[low[0] : low[-1] + 1] = min(profile[left], profile[right])
            profile[low[-1] + 1 : right] = profile[right]


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def _measure_differences(
    candidates: Float64[ndarray, "c w w v"], wanted: Float64[ndarray, "w w v"], there: Bool[ndarray, "w w"]
) -> Float64[ndarray, " c"]:
    """Mean over the cells that are `there` of each candidate's squared difference from what is `wanted`."""
    sums = np.empty(len(candidates))
    count = np.count_nonzero(there)
    for number in numba.prange(len(candidates)):
        total = 0.0
        for row in range(there.shape[0]):
            for column in range(there.shape[1]):
                if there[row, column]:
                    for k in range(wanted.shape[2]):
                        difference = candidates[number, row, column, k] - wanted[row, column, k]
                        total += difference * difference
        sums[number] = total / count
    return sums


@dataclass(frozen=True)
class _Wanted:
    """What is to be filled around a place, and what it must go with."""

    todo: Bool[ndarray, "w w"]
    on_lines: Float64[ndarray, "f v"]
    """What is known on the line of each cell to be filled, NaN where nothing is."""
    filled: Float64[ndarray, "t v"]
    """What is there already."""


def _find_best(
    candidates: Float64[ndarray, "c w w v"],
    wanted: _Wanted,
    least: Float64[ndarray, " c"],
    scales: Float64[ndarray, " c"],
    config: ExemplarConfig,
) -> int:
    """The candidate whose cost times its scale is least, the first of several.

    `least` is what each costs without what it brings. Those that are too expensive without it are not looked at.
    """
    told = np.isfinite(wanted.on_lines).all(axis=1)
    old = np.concatenate([wanted.filled, wanted.on_lines[told]])
    bounds = least * scales
    order = np.argsort(bounds, kind="stable")
    best, cheapest = -1, np.inf
    for start in range(0, len(order), _BATCH):
        rows = order[start : start + _BATCH]
        if bounds[rows[0]] > cheapest:
            break
        brought = candidates[rows][:, wanted.todo]
        costs = least[rows] + config.novelty_penalty * _measure_novelty(brought, old)
        if told.any():
            away = ((brought - wanted.on_lines)[:, told] ** 2).sum(axis=2).mean(axis=1)
            costs += config.line_penalty * away
        costs *= scales[rows]
        place = int(np.lexsort([rows, costs])[0])
        if (costs[place], rows[place]) < (cheapest, best):
            best, cheapest = int(rows[place]), float(costs[place])
    return best


def _measure_novelty(brought: Float64[ndarray, "c f v"], filled: Float64[ndarray, "t v"]) -> Float64[ndarray, " c"]:
    """Mean over the cells that each candidate brings of the squared difference from the likest filled one."""
    squares = (brought**2).sum(axis=2)[..., None] + (filled**2).sum(axis=1) - 2 * brought @ filled.T
    return np.maximum(squares.min(axis=2), 0).mean(axis=1)


def _cut_window(
    known: Bool[ndarray, "a b"],
    hole: Bool[ndarray, "a b"],
    config: ExemplarConfig,
    guide: Float64[ndarray, "a b"] | None,
) -> int | None:
    """The largest size of which there are enough pieces, of whatever belongs into the hole; None where nothing is
    known."""
    found = {window: _find_whole_windows(known, window) for window in config.windows}
    some = [window for window, middles in found.items() if len(middles)]
    if guide is not None and some:
        told = {window: _find_told_share(guide, found[window], hole, config.guide_reach) for window in some}
        some = [window for window in some if told[window] >= config.told_share * max(told.values())]
    enough = [window for window in some if len(found[window]) >= config.min_candidates]
    return next(iter(enough or some), None)


def _find_told_share(
    guide: Float64[ndarray, "a b"], middles: Int64[ndarray, "c 2"], hole: Bool[ndarray, "a b"], reach: float
) -> float:
    """Share of the hole for which there is a piece from where the guide says nearly the same."""
    values = np.sort(guide[tuple(middles.T)])
    asked = guide[hole]
    near = np.searchsorted(values, asked + reach, "right") > np.searchsorted(values, asked - reach, "left")
    return float(near.mean()) if len(near) else 1.0


def _find_whole_windows(known: Bool[ndarray, "a b"], window: int) -> Int64[ndarray, "c 2"]:
    """Middles of the squares in which every cell is known."""
    return np.argwhere(ndimage.binary_erosion(known, np.ones((window, window)), border_value=0))


def _cut_pieces(
    picture: Shaped[ndarray, "p q *v"], middles: Int64[ndarray, "c 2"], window: int
) -> Shaped[ndarray, "c w w *v"]:
    """Copy the squares around cells of a picture that has a margin of half a window."""
    squares = sliding_window_view(picture, (window, window), axis=(0, 1))[tuple(middles.T)]
    return np.moveaxis(squares, (-2, -1), (1, 2)).copy()


def _choose_next_middle(filled: Bool[ndarray, "p q"], todo: Bool[ndarray, "p q"], window: int) -> Int64[ndarray, "2"]:
    """Choose the missing cell with most filled ones around it, in cells of the picture without its margin."""
    support = ndimage.uniform_filter(filled.astype(np.float64), window, mode="constant")
    support[~todo] = -1
    return np.array(np.unravel_index(int(support.argmax()), todo.shape)) - window // 2
