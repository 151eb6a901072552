"""A picture of how a scene's splats are spread: opacity, size, flatness, colour, place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray
from PIL import Image, ImageDraw, ImageFont

from instdrive_core.maths.spherical_harmonics import color_from_dc
from instdrive_core.scene.gaussians import Gaussians

PANEL = (400, 240)
"""Pixels, width and height, of one histogram with its title and axis."""
COLUMNS = 2
BINS = 80
_LEFT, _TOP, _RIGHT, _BOTTOM = 14, 34, 14, 28
_PAPER, _INK, _FAINT, _BAR = (255, 255, 255), (40, 44, 52), (205, 209, 216), (66, 120, 200)
_LOG_LIMIT = 87.0
"""exp of it still fits float32."""


@dataclass(frozen=True)
class Histogram:
    """One quantity of every splat that has a finite one."""

    title: str
    counts: ndarray
    """(BINS,) splats."""
    low: float
    high: float
    left_out: int
    """Splats outside the range, or whose value is not finite."""
    is_log: bool = False
    """Whether `low` and `high` are decimal logarithms."""


def build_histograms(gaussians: Gaussians) -> tuple[Histogram, ...]:
    """Opacity, longest axis, longest to shortest axis, brightness, and the three coordinates.

    Ranges that the data sets span 99.8 % of the values, so that one outlier does not press all others into one bar.
    """
    with np.errstate(invalid="ignore"):
        logs = np.clip(gaussians.log_scales, -_LOG_LIMIT, _LOG_LIMIT) / np.float32(np.log(10))
        longest, shortest = logs.max(axis=1), logs.min(axis=1)
        brightness = color_from_dc(gaussians.sh_dc).mean(axis=1)
        return (
            _build_histogram("opacity", gaussians.opacities, (0.0, 1.0)),
            _build_histogram("longest axis, m (standard deviation)", longest, is_log=True),
            _build_histogram("longest / shortest axis", longest - shortest, is_log=True),
            _build_histogram("brightness of the base colour", brightness),
            *(_build_histogram(f"{name}, m", gaussians.means[:, axis]) for axis, name in enumerate("xyz")),
        )


def draw_histograms(gaussians: Gaussians) -> UInt8[ndarray, "h w 3"]:
    """All histograms on one page."""
    drawn = build_histograms(gaussians)
    rows = -(-len(drawn) // COLUMNS)
    page = Image.new("RGB", (PANEL[0] * COLUMNS, PANEL[1] * rows), _PAPER)
    draw = ImageDraw.Draw(page)
    for index, histogram in enumerate(drawn):
        _draw_panel(draw, histogram, (index % COLUMNS * PANEL[0], index // COLUMNS * PANEL[1]))
    return np.asarray(page)


def _build_histogram(
    title: str, values: Float[ndarray, " n"], limits: tuple[float, float] | None = None, is_log: bool = False
) -> Histogram:
    finite = values[np.isfinite(values)].astype(np.float64)
    if limits is None:
        low, high = np.quantile(finite, [0.001, 0.999]) if len(finite) else (0.0, 1.0)
        margin = 0.02 * (high - low) or max(1e-3 * abs(low), 1e-6)
        limits = (float(low - margin), float(high + margin))
    counts, _ = np.histogram(finite, BINS, limits)
    return Histogram(title, counts, *limits, len(values) - int(counts.sum()), is_log)


def _draw_panel(draw: ImageDraw.ImageDraw, histogram: Histogram, corner: tuple[int, int]) -> None:
    left, top = corner[0] + _LEFT, corner[1] + _TOP
    right, bottom = corner[0] + PANEL[0] - _RIGHT, corner[1] + PANEL[1] - _BOTTOM
    small, large = ImageFont.load_default(11), ImageFont.load_default(13)
    draw.text((left, corner[1] + 10), histogram.title, _INK, large)
    if histogram.left_out:
        draw.text((right, corner[1] + 12), f"{histogram.left_out:,} outside", _INK, small, anchor="ra")
    edges = np.round(np.linspace(left, right, BINS + 1)).astype(int)
    heights = np.round(histogram.counts / max(int(histogram.counts.max()), 1) * (bottom - top)).astype(int)
    # What is there shows, however few.
    heights = np.where(histogram.counts > 0, np.maximum(heights, 1), 0)
    for start, stop, height in zip(edges[:-1], edges[1:], heights, strict=True):
        if height:
            draw.rectangle((int(start), bottom - int(height), int(stop) - 2, bottom - 1), _BAR)
    draw.line((left, bottom, right, bottom), _FAINT)
    for place, anchor in ((0.0, "la"), (0.5, "ma"), (1.0, "ra")):
        value = histogram.low + place * (histogram.high - histogram.low)
        at = (left + place * (right - left), bottom + 6)
        draw.text(at, f"{10**value if histogram.is_log else value:.3g}", _INK, small, anchor=anchor)
