"""A viewpoint as JSON values, and back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from instdrive_app.state import Intrinsics, Viewpoint

_LENS = ("fx", "fy", "cx", "cy", "width", "height")


def store_viewpoint(viewpoint: Viewpoint) -> dict[str, Any]:
    """Convert a viewpoint into JSON values."""
    return {
        "world_from_camera": viewpoint.world_from_camera.tolist(),
        "lens": {name: getattr(viewpoint.lens, name) for name in _LENS},
        "pivot_distance": viewpoint.pivot_distance,
        "zoom": viewpoint.zoom,
    }


def read_viewpoint(values: Mapping[str, Any]) -> Viewpoint | None:
    """Read what `store_viewpoint` gave; None where it is no rigid pose and lens."""
    try:
        pose = np.array(values["world_from_camera"], float)
        kept = values["lens"]
        fx, fy, cx, cy = (float(kept[name]) for name in _LENS[:4])
        lens = Intrinsics(fx, fy, cx, cy, int(kept["width"]), int(kept["height"]))
        distance, zoom = float(values["pivot_distance"]), float(values.get("zoom", 1.0))
    except (KeyError, TypeError, ValueError, OverflowError):
        return None
    numbers = (distance, zoom, lens.fx, lens.fy, lens.cx, lens.cy)
    if pose.shape != (4, 4) or not np.isfinite(pose).all() or not all(map(math.isfinite, numbers)):
        return None
    turn = pose[:3, :3]
    if (
        not np.allclose(turn @ turn.T, np.eye(3), atol=1e-3)
        or min(zoom, lens.fx, lens.fy, lens.width, lens.height) <= 0
    ):
        return None
    return Viewpoint(pose, lens, distance, zoom=zoom)
