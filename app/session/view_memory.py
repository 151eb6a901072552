"""The user's view of a scene as JSON values for the project file, and back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from instdrive_app.session.navigation import Navigation
from instdrive_app.state import EditorState, ViewMode
from instdrive_app.stored_viewpoint import read_viewpoint, store_viewpoint


def store_view(state: EditorState) -> dict[str, Any]:
    """Convert camera, time and view mode into JSON values."""
    return {
        "view_mode": state.view_mode.name,
        "time": state.time,
        "dataset_view": state.dataset_view,
        **store_viewpoint(state.viewpoint),
    }


def restore_view(view: Mapping[str, Any], state: EditorState, navigation: Navigation, views: int) -> bool:
    """Restore a view that `store_view` wrote, in a scene of `views` dataset cameras; returns whether it was valid.

    What another version or hand has written may not fit; then nothing is changed.
    """
    try:
        mode, time = ViewMode[view["view_mode"]], float(view["time"])
        index = view["dataset_view"]
    except (KeyError, TypeError, ValueError):
        return False
    viewpoint = read_viewpoint(view)
    if viewpoint is None or not math.isfinite(time):
        return False
    state.view_mode = mode
    if isinstance(index, int) and 0 <= index < views:
        navigation.look_through(index)
    else:
        navigation.look_from(viewpoint)
        state.time = time
    return True
