"""Telling sunlit ground from shaded ground of the same kind by its brightness.

Pavements in the shade are as bright as roads in the sun, so each kind of ground has a level of its own; how much
darker shade is holds for all of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray

DARKEST = 0.02
"""Brightness below which nothing is told apart."""
SPREAD = 0.13
"""Standard deviation of the logarithm of the brightness of one kind of ground in one light."""
STRAY_DENSITY = 0.02 * np.exp(-1)
"""Density of ground that is neither, such as marks and covers."""
MOST_TOLD = 2.5
"""Logarithm of the odds that one cell tells at most."""
_STEP = 0.03
_RATIOS = np.arange(0.3, 1.3, 0.05)
_FEWEST = 40


@dataclass(frozen=True)
class TwoLights:
    """How bright ground is in the sun and in the shade."""

    levels: Float64[ndarray, "2"]
    """Logarithms of the brightness in the sun of carriageways and of what lies higher; NaN = not enough is known."""
    ratio: float
    """Logarithm of how much brighter ground is in the sun than in the shade."""

    def tell_shade(self, color: Float64[ndarray, "... 3"], raised: Bool[ndarray, "..."]) -> Float64[ndarray, "..."]:
        """Logarithm of how much likelier colours are in the shade than in the sun, within ±`MOST_TOLD`; 0 where
        nothing is known of such ground."""
        brightness = np.log(np.maximum(color.mean(axis=-1), DARKEST))
        level = np.where(raised, self.levels[1], self.levels[0])
        away = brightness - np.where(np.isfinite(level), level, 0)
        told = _compute_density(away + self.ratio) - _compute_density(away)
        return np.where(np.isfinite(level), np.clip(told, -MOST_TOLD, MOST_TOLD), 0)


def fit_two_lights(color: Float64[ndarray, "n 3"], raised: Bool[ndarray, " n"]) -> TwoLights | None:
    """The likeliest levels of ground of these colours (0 … 1), some of it `raised`; None where there is too little."""
    brightness = np.log(np.maximum(color.mean(axis=-1), DARKEST))
    totals, levels = np.zeros(len(_RATIOS)), np.full((len(_RATIOS), 2), np.nan)
    for kind in (0, 1):
        values = brightness[raised == bool(kind)]
        if len(values) < _FEWEST:
            continue
        counts, edges = np.histogram(values, np.arange(values.min() - _STEP, values.max() + 2 * _STEP, _STEP))
        middles = (edges[1:] + edges[:-1]) / 2
        candidates = np.arange(middles[0], middles[-1] + _RATIOS[0], _STEP)
        lit = np.exp(_compute_density(middles - candidates[:, None]))
        for number, ratio in enumerate(_RATIOS):
            shaded = np.exp(_compute_density(middles - candidates[:, None] + ratio))
            likely = np.log((lit + shaded) / 2) @ counts
            best = int(likely.argmax())
            totals[number] += likely[best]
            levels[number, kind] = candidates[best]
    if not np.isfinite(levels).any():
        return None
    chosen = int(totals.argmax())
    return TwoLights(levels[chosen], float(_RATIOS[chosen]))


def measure_dimming(
    color: Float64[ndarray, "n 3"], raised: Bool[ndarray, " n"], told: Float64[ndarray, " n"], lights: TwoLights
) -> Float64[ndarray, "2 3"]:
    """Which share of R, G and B is left in the shade, of carriageways and of what lies higher."""
    found = np.full((2, 3), np.nan)
    for kind in (0, 1):
        mine = raised == bool(kind)
        lit, shaded = color[mine & (told < -1)], color[mine & (told > 1)]
        if min(len(lit), len(shaded)) >= _FEWEST // 2:
            found[kind] = np.median(shaded, axis=0) / np.maximum(np.median(lit, axis=0), DARKEST)
    other = np.where(np.isfinite(found), found, found[::-1])
    return np.clip(np.where(np.isfinite(other), other, np.exp(-lights.ratio)), 0.1, 1.0)


def _compute_density(away: Float64[ndarray, "..."]) -> Float64[ndarray, "..."]:
    """Logarithm of the density of ground so far from its level."""
    return np.logaddexp(-0.5 * (away / SPREAD) ** 2 - np.log(SPREAD), np.log(STRAY_DENSITY))
