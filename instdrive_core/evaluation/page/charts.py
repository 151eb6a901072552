"""Line charts as inline SVG."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.evaluation.page.elements import Markup, element

WIDTH, HEIGHT = 520, 260
_LEFT, _RIGHT, _TOP, _BOTTOM = 54, 12, 28, 34
_MAX_POINTS = 300
_SMOOTHED = 0.05
"""Share of a curve's points that its running mean covers."""
_COLORS = 6


@dataclass(frozen=True)
class Curve:
    """One named line; points that are not finite are left out."""

    name: str
    x: Float64[ndarray, " n"]
    y: Float64[ndarray, " n"]


def line_chart(title: str, unit: str, curves: Sequence[Curve], logarithmic: bool = False) -> Markup | None:
    """A chart of noisy curves: thin as they are, bold as running means; None where there is nothing to draw.

    Args:
        unit: of the horizontal axis.
        logarithmic: values that are not positive are left out.
    """
    curves = [kept for curve in curves if len((kept := _drawable(curve, logarithmic)).x) > 1]
    if not curves:
        return None
    y = [np.log10(curve.y) if logarithmic else curve.y for curve in curves]
    x_ticks, y_ticks = _ticks(_range([curve.x for curve in curves])), _ticks(_value_range(y), whole=logarithmic)
    across = _scale((x_ticks[0], x_ticks[-1]), (_LEFT, WIDTH - _RIGHT))
    up = _scale((y_ticks[0], y_ticks[-1]), (HEIGHT - _BOTTOM, _TOP))
    parts = [element("text", title, x=_LEFT, y=14, class_="title")]
    parts += [_horizontal(up(tick), _number(10**tick if logarithmic else tick)) for tick in y_ticks]
    parts += [
        element("text", _number(tick), x=_round(across(tick)), y=HEIGHT - _BOTTOM + 15, text_anchor="middle")
        for tick in x_ticks
    ]
    parts.append(element("text", unit, x=WIDTH - _RIGHT, y=HEIGHT - 4, text_anchor="end"))
    for number, (curve, values) in enumerate(zip(curves, y, strict=True)):
        color = f"stroke:var(--s{number % _COLORS})"
        parts.append(element("path", d=_path(across(curve.x), up(values)), style=color, class_="raw"))
        parts.append(element("path", d=_path(across(curve.x), up(_running_mean(values))), style=color))
    chart = element("svg", *parts, viewBox=f"0 0 {WIDTH} {HEIGHT}", role="img", aria_label=title)
    return element("figure", chart, _legend([curve.name for curve in curves]))


def _drawable(curve: Curve, logarithmic: bool) -> Curve:
    kept = np.isfinite(curve.x) & np.isfinite(curve.y)
    if logarithmic:
        kept &= curve.y > 0
    x, y = curve.x[kept], curve.y[kept]
    if len(x) > _MAX_POINTS:
        groups = np.linspace(0, len(x), _MAX_POINTS + 1).astype(int)[:-1]
        sizes = np.diff(np.append(groups, len(x)))
        x, y = np.add.reduceat(x, groups) / sizes, np.add.reduceat(y, groups) / sizes
    return Curve(curve.name, x, y)


def _running_mean(values: Float64[ndarray, " n"]) -> Float64[ndarray, " n"]:
    """Centred; the window shrinks at the ends."""
    half = max(1, round(len(values) * _SMOOTHED / 2))
    sums = np.concatenate([[0.0], np.cumsum(values)])
    place = np.arange(len(values))
    first, last = np.maximum(place - half, 0), np.minimum(place + half + 1, len(values))
    return (sums[last] - sums[first]) / (last - first)


def _range(arrays: Sequence[Float64[ndarray, " n"]]) -> tuple[float, float]:
    low, high = min(float(each.min()) for each in arrays), max(float(each.max()) for each in arrays)
    return (low, high) if high > low else (low - 0.5, high + 0.5)


def _value_range(arrays: Sequence[Float64[ndarray, " n"]]) -> tuple[float, float]:
    """Without the outermost percent at either end: one bad step would flatten the rest."""
    pooled = np.concatenate(arrays)
    return _range([np.quantile(pooled, [0.005, 0.995])])


def _ticks(bounds: tuple[float, float], whole: bool = False) -> Float64[ndarray, " t"]:
    """About five round numbers that enclose the bounds; `whole` ones for exponents."""
    rough = (bounds[1] - bounds[0]) / 5
    power = 10.0 ** np.floor(np.log10(rough))
    step = next(power * factor for factor in (1, 2, 5, 10) if power * factor >= rough)
    step = max(1.0, np.ceil(rough)) if whole else step
    return np.arange(np.floor(bounds[0] / step), np.ceil(bounds[1] / step) + 1) * step


def _scale(values: tuple[float, float], pixels: tuple[float, float]):
    low, high = min(pixels), max(pixels)
    factor = (pixels[1] - pixels[0]) / (values[1] - values[0])
    return lambda value: np.clip(pixels[0] + (value - values[0]) * factor, low, high)


def _horizontal(y: float, label: str) -> Markup:
    line = element("line", x1=_LEFT, x2=WIDTH - _RIGHT, y1=_round(y), y2=_round(y))
    return element("g", line, element("text", label, x=_LEFT - 6, y=_round(y + 4), text_anchor="end"))


def _legend(names: Sequence[str]) -> Markup:
    entries = []
    for number, name in enumerate(names):
        swatch = element("span", class_="swatch", style=f"background:var(--s{number % _COLORS})")
        entries.append(element("span", swatch, name))
    return element("figcaption", element("span", *entries, class_="legend"))


def _path(x: Float64[ndarray, " n"], y: Float64[ndarray, " n"]) -> str:
    return "M" + " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x.tolist(), y.tolist(), strict=True))


def _number(value: float) -> str:
    return f"{value:.3g}" if abs(value) < 10000 else f"{value:,.0f}"


def _round(value: float) -> float:
    return round(float(value), 1)
