"""The user's view of a scene as JSON values for the project file, and back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from instdrive_app.session.navigation import Navigation
from instdrive_app.state import EditorState, Intrinsics, ViewMode, Viewpoint

_LENS = ("fx", "fy", "cx", "cy", "width", "height")


def store_view(state: EditorState) -> dict[str, Any]:
    """Convert camera, time and view mode into JSON values."""
    viewpoint = state.viewpoint
    return {
        "view_mode": state.view_mode.name,
        "time": state.time,
        "dataset_view": state.dataset_view,
        "world_from_camera": viewpoint.world_from_camera.tolist(),
        "lens": {name: getattr(viewpoint.lens, name) for name in _LENS},
        "pivot_distance": viewpoint.pivot_distance,
    }


def restore_view(view: Mapping[str, Any], state: EditorState, navigation: Navigation, views: int) -> bool:
    """Restore a view that `store_view` wrote, in a scene of `views` dataset cameras; returns whether it was valid.

    What another version or hand has written may not fit; then nothing is changed.
    """
    try:
        mode, time = ViewMode[view["view_mode"]], float(view["time"])
        index = view["dataset_view"]
        pose = np.array(view["world_from_camera"], float)
        kept = view["lens"]
        fx, fy, cx, cy = (float(kept[name]) for name in _LENS[:4])
        lens = Intrinsics(fx, fy, cx, cy, int(kept["width"]), int(kept["height"]))
        distance = float(view["pivot_distance"])
    except (KeyError, TypeError, ValueError):
        return False
    numbers = (time, distance, lens.fx, lens.fy, lens.cx, lens.cy)
    if pose.shape != (4, 4) or not np.isfinite(pose).all() or not all(map(math.isfinite, numbers)):
        return False
    turn = pose[:3, :3]
    if not np.allclose(turn @ turn.T, np.eye(3), atol=1e-3) or min(lens.fx, lens.fy, lens.width, lens.height) <= 0:
        return False
    state.view_mode = mode
    if isinstance(index, int) and 0 <= index < views:
        navigation.look_through(index)
    else:
        navigation.look_from(Viewpoint(pose, lens, distance))
        state.time = time
    return True
