"""Themes: the colours of text, panels and accents, and how well one can be read on another."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

Color = tuple[float, float, float]
"""Red, green and blue in sRGB, 0 … 1."""


class Role(Enum):
    """What a colour of the window is for; the value is its field of `Theme`."""

    BACKGROUND = "background"
    PANEL = "panel"
    POPUP = "popup"
    RAISED = "raised"
    HOVER = "hover"
    LINE = "line"
    TEXT = "text"
    DIM = "dim"
    ACCENT = "accent"
    ON_ACCENT = "on_accent"
    ERROR = "error"
    GOOD = "good"


@dataclass(frozen=True)
class Theme:
    """One set of colours for the whole window."""

    title: str
    is_light: bool
    background: Color
    """Bars, and what lies behind panels."""
    panel: Color
    popup: Color
    raised: Color
    """Buttons and fields."""
    hover: Color
    """What the mouse is over."""
    line: Color
    text: Color
    dim: Color
    """Text of less weight."""
    accent: Color
    on_accent: Color
    """Text on what is filled with the accent."""
    error: Color
    good: Color
    fill: float
    """Opacity of the accent beneath text: chosen lines, sliders' thumbs, and what is pressed."""
    frame_border: float = 0.0
    """Width of the line around buttons and fields, in pixels."""


THEMES = {
    "dark": Theme(
        "Dark",
        is_light=False,
        background=(0.086, 0.094, 0.106),
        panel=(0.114, 0.122, 0.137),
        popup=(0.135, 0.145, 0.162),
        raised=(0.165, 0.176, 0.196),
        hover=(0.220, 0.235, 0.262),
        line=(0.200, 0.212, 0.235),
        text=(0.885, 0.895, 0.910),
        dim=(0.635, 0.660, 0.700),
        accent=(1.000, 0.720, 0.200),
        on_accent=(0.086, 0.094, 0.106),
        error=(0.990, 0.515, 0.475),
        good=(0.420, 0.780, 0.520),
        fill=0.30,
    ),
    "light": Theme(
        "Light",
        is_light=True,
        background=(0.880, 0.890, 0.905),
        panel=(0.955, 0.960, 0.968),
        popup=(0.975, 0.978, 0.984),
        raised=(0.885, 0.893, 0.908),
        hover=(0.815, 0.830, 0.855),
        line=(0.730, 0.750, 0.780),
        text=(0.090, 0.100, 0.120),
        dim=(0.290, 0.310, 0.350),
        accent=(0.540, 0.280, 0.000),
        on_accent=(1.000, 1.000, 1.000),
        error=(0.660, 0.080, 0.070),
        good=(0.030, 0.360, 0.130),
        fill=0.36,
    ),
    "high contrast": Theme(
        "High contrast",
        is_light=False,
        background=(0.0, 0.0, 0.0),
        panel=(0.0, 0.0, 0.0),
        popup=(0.0, 0.0, 0.0),
        raised=(0.070, 0.070, 0.070),
        hover=(0.200, 0.200, 0.240),
        line=(0.780, 0.780, 0.780),
        text=(1.0, 1.0, 1.0),
        dim=(0.880, 0.880, 0.880),
        accent=(1.000, 0.860, 0.000),
        on_accent=(0.0, 0.0, 0.0),
        error=(1.000, 0.680, 0.640),
        good=(0.500, 1.000, 0.600),
        fill=0.21,
        frame_border=1.0,
    ),
}
"""Themes by the names under which preferences keep them; the first one is the default."""
DEFAULT_THEME = "dark"

BACKGROUND, PANEL, POPUP, RAISED, HOVER, LINE = (
    Role.BACKGROUND,
    Role.PANEL,
    Role.POPUP,
    Role.RAISED,
    Role.HOVER,
    Role.LINE,
)
TEXT, DIM, ACCENT, ON_ACCENT, ERROR, GOOD = (
    Role.TEXT,
    Role.DIM,
    Role.ACCENT,
    Role.ON_ACCENT,
    Role.ERROR,
    Role.GOOD,
)

PICTURE_TEXT: Color = (0.885, 0.895, 0.910)
"""What is written and drawn on the picture itself is the same in every theme: the picture is."""
PICTURE_SHADE: Color = (0.086, 0.094, 0.106)
PICTURE_ACCENT: Color = (1.000, 0.720, 0.200)


def blend_colors(front: Color, alpha: float, behind: Color) -> Color:
    """Blend a colour of some opacity over another."""
    red, green, blue = (alpha * a + (1 - alpha) * b for a, b in zip(front, behind, strict=True))
    return red, green, blue


def measure_contrast(one: Color, other: Color) -> float:
    """Measure the contrast of two colours, 1 … 21 (WCAG 2.2, contrast ratio)."""
    low, high = sorted((_measure_luminance(one), _measure_luminance(other)))
    return (high + 0.05) / (low + 0.05)


def _measure_luminance(color: Color) -> float:
    """Relative luminance, 0 … 1 (WCAG 2.2)."""
    red, green, blue = (value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4 for value in color)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue
