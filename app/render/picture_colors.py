"""Colours that both renderers draw with, in [0, 1]."""

from __future__ import annotations

BACKDROP = (0.055, 0.06, 0.07)
"""RGB where the scene has no sky."""
DEPTH_RAMP = (
    (0.99, 0.91, 0.55),
    (0.98, 0.62, 0.32),
    (0.86, 0.31, 0.36),
    (0.55, 0.18, 0.51),
    (0.25, 0.16, 0.46),
    (0.06, 0.08, 0.20),
)
"""RGB of the depth view, near to far."""
SELECTED_LINE = (1.0, 0.72, 0.20, 1.0)
SELECTED_TINT = (1.0, 0.80, 0.40, 0.16)
HOVERED_LINE = (1.0, 1.0, 1.0, 0.95)
