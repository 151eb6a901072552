"""Line charts: what their template draws as inline SVG."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

WIDTH, HEIGHT = 520, 260
_LEFT, _RIGHT, _TOP, _BOTTOM = 54, 12, 28, 34
_MAX_POINTS = 300
_SMOOTHED = 0.05
"""Share of a curve's points that its running mean covers."""
_COLORS = 6

Scale = Callable[[Any], Any]
"""Turns values, one or an array of them, into pixels."""


@dataclass(frozen=True)
class Curve:
    """One named line; points that are not finite are left out."""

    name: str
    x: Float64[ndarray, " n"]
    y: Float64[ndarray, " n"]


@dataclass(frozen=True)
class Tick:
    """A labelled place on an axis, in pixels of the chart."""

    position: float
    label: str


@dataclass(frozen=True)
class DrawnCurve:
    """A curve as SVG path data."""

    name: str
    color: str
    raw: str
    """Path through all points."""
    mean: str
    """Path of the running mean."""


@dataclass(frozen=True)
class LineChart:
    """Noisy curves in one frame, thin as they are and bold as running means; the template draws them as SVG."""

    title: str
    unit: str
    """Unit of the horizontal axis."""
    x_ticks: Sequence[Tick]
    y_ticks: Sequence[Tick]
    lines: Sequence[DrawnCurve]
    width: int = WIDTH
    height: int = HEIGHT
    left: int = _LEFT
    right: int = WIDTH - _RIGHT
    bottom: int = HEIGHT - _BOTTOM


def build_line_chart(title: str, unit: str, curves: Sequence[Curve], logarithmic: bool = False) -> LineChart | None:
    """Lay out a chart; None where there is nothing to draw.

    Args:
        title: heading of the chart.
        unit: unit of the horizontal axis.
        curves: lines to draw; those with less than two drawable points are left out.
        logarithmic: whether the vertical axis is; values that are not positive are left out.
    """
    curves = [kept for curve in curves if len((kept := _select_drawable(curve, logarithmic)).x) > 1]
    if not curves:
        return None
    y = [np.log10(curve.y) if logarithmic else curve.y for curve in curves]
    x_ticks = _choose_ticks(_find_range([curve.x for curve in curves]))
    y_ticks = _choose_ticks(_find_value_range(y), whole=logarithmic)
    across = _build_scale((x_ticks[0], x_ticks[-1]), (_LEFT, WIDTH - _RIGHT))
    up = _build_scale((y_ticks[0], y_ticks[-1]), (HEIGHT - _BOTTOM, _TOP))
    lines = [
        DrawnCurve(
            curve.name,
            f"var(--s{number % _COLORS})",
            _build_path(across(curve.x), up(values)),
            _build_path(across(curve.x), up(_compute_running_mean(values))),
        )
        for number, (curve, values) in enumerate(zip(curves, y, strict=True))
    ]
    return LineChart(
        title,
        unit,
        _label_ticks(x_ticks, across),
        _label_ticks(y_ticks, up, logarithmic),
        lines,
    )


def _select_drawable(curve: Curve, logarithmic: bool) -> Curve:
    kept = np.isfinite(curve.x) & np.isfinite(curve.y)
    if logarithmic:
        kept &= curve.y > 0
    x, y = curve.x[kept], curve.y[kept]
    if len(x) > _MAX_POINTS:
        groups = np.linspace(0, len(x), _MAX_POINTS + 1).astype(int)[:-1]
        sizes = np.diff(np.append(groups, len(x)))
        x, y = np.add.reduceat(x, groups) / sizes, np.add.reduceat(y, groups) / sizes
    return Curve(curve.name, x, y)


def _compute_running_mean(values: Float64[ndarray, " n"]) -> Float64[ndarray, " n"]:
    """Centred running mean; the window shrinks at the ends."""
    half = max(1, round(len(values) * _SMOOTHED / 2))
    sums = np.concatenate([[0.0], np.cumsum(values)])
    place = np.arange(len(values))
    first, last = np.maximum(place - half, 0), np.minimum(place + half + 1, len(values))
    return (sums[last] - sums[first]) / (last - first)


def _find_range(arrays: Sequence[Float64[ndarray, " _"]]) -> tuple[float, float]:
    low, high = min(float(each.min()) for each in arrays), max(float(each.max()) for each in arrays)
    return (low, high) if high > low else (low - 0.5, high + 0.5)


def _find_value_range(arrays: Sequence[Float64[ndarray, " _"]]) -> tuple[float, float]:
    """Find the range of all but the outermost values: one bad step would flatten the rest."""
    pooled = np.concatenate(arrays)
    return _find_range([np.quantile(pooled, [0.005, 0.995])])


def _choose_ticks(bounds: tuple[float, float], whole: bool = False) -> Float64[ndarray, " t"]:
    """About five round numbers that enclose the bounds; `whole` ones for exponents."""
    rough = (bounds[1] - bounds[0]) / 5
    power = 10.0 ** np.floor(np.log10(rough))
    step = next(power * factor for factor in (1, 2, 5, 10) if power * factor >= rough)
    step = max(1.0, np.ceil(rough)) if whole else step
    return np.arange(np.floor(bounds[0] / step), np.ceil(bounds[1] / step) + 1) * step


def _label_ticks(ticks: Float64[ndarray, " t"], place: Scale, logarithmic: bool = False) -> list[Tick]:
    """Place ticks and write their values with as many digits as tell neighbours apart; exponents as powers of ten."""
    digits = max(0, -int(np.floor(np.log10(ticks[1] - ticks[0]) + 1e-9)))
    labels = [f"{10**tick:.3g}" if logarithmic else f"{tick:,.{digits}f}" for tick in ticks.tolist()]
    return [Tick(_round(place(tick)), label) for tick, label in zip(ticks, labels, strict=True)]


def _build_scale(values: tuple[float, float], pixels: tuple[float, float]) -> Scale:
    low, high = min(pixels), max(pixels)
    factor = (pixels[1] - pixels[0]) / (values[1] - values[0])
    return lambda value: np.clip(pixels[0] + (value - values[0]) * factor, low, high)


def _build_path(x: Float64[ndarray, " n"], y: Float64[ndarray, " n"]) -> str:
    return "M" + " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x.tolist(), y.tolist(), strict=True))


def _round(value: float) -> float:
    return round(float(value), 1)
