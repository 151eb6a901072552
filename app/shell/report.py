"""Reporting what the window shows as JSON lines, for programs that drive it (tests, demonstrations)."""

from __future__ import annotations

import json
import os
from dataclasses import asdict
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from instdrive_app.language.translation import get_language
from instdrive_app.panels.widgets.ui import Ui
from instdrive_core.edits.kinds.light.lay_shadow import find_shadowed
from instdrive_core.scene.selection import Flag


class Reporter:
    """Appends a line whenever the report changes; touches the file in every frame."""

    def __init__(self, path: Path) -> None:
        self._file: TextIO = path.open("w", encoding="utf-8")
        self._last = ""

    def write(self, ui: Ui) -> None:
        """Report the state at the end of a frame."""
        line = json.dumps(describe_window(ui))
        if line != self._last:
            self._file.write(line + "\n")
            self._file.flush()
            self._last = line
        os.utime(self._file.fileno() if os.utime in os.supports_fd else self._file.name)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def describe_window(ui: Ui) -> dict[str, Any]:
    """Describe state, selection, history, camera, messages, places of widgets (window pixels), which are disabled."""
    session, document = ui.session, ui.session.document
    state: dict[str, Any] = {
        "sketch": _describe_sketch(ui),
        "busy": session.jobs.current.title if session.jobs.current else None,
        "settled": ui.view.settled,
        "language": get_language(),
        "preferences": asdict(session.preferences.current),
        "messages": [message.text for message in session.messages.log],
        "widgets": {name: [round(value, 1) for value in rect] for name, rect in sorted(ui.marks.items())},
        "disabled": sorted(ui.disabled),
    }
    if document is None:
        return state | {"open": False}
    camera = ui.view.snapshot.camera if ui.view.snapshot else None
    return state | {
        "open": True,
        "view_mode": session.state.view_mode.name,
        "time": session.state.time,
        "reference": {
            "kind": session.state.reference.name,
            "opacity": session.state.reference_opacity,
            "comparison": session.state.comparison.name,
            "wipe": session.state.wipe,
            "psnr": session.difference.psnr,
        },
        "hovered": session.state.hovered,
        "cameras": {
            "shown": list(session.cameras.list_shown()),
            "hovered": session.state.hovered_camera,
            "looked_through": session.state.dataset_view,
        },
        "tool": session.state.tool,
        "map": session.map.window and {**asdict(session.map.window), "painted": not session.map.is_painting},
        "way_keys": [[round(value, 3) for value in (key.time, key.x, key.y)] for key in session.ways.keys],
        "ego_way": [[round(value, 3) for value in place] for place in session.ego_way.places],
        "box": session.aids.box.box and [*session.aids.box.box.center.tolist(), *session.aids.box.box.size.tolist()],
        "measured": session.aids.ruler.describe(),
        "bookmarks": [kept.name for kept in session.aids.bookmarks.kept],
        "path_keys": [key.at for key in session.camera_path.keys],
        "selected": list(session.selection.ids),
        "selected_splats": int(np.count_nonzero(document.state.find_mask(Flag.SELECTED))),
        "shadowed": sorted(find_shadowed(document)),
        "visible": list(document.find_visible_instances()),
        "history": [edit.title for edit in document.history.edits],
        "cursor": document.history.cursor,
        "unsaved": session.files.is_unsaved,
        "camera": camera
        and {
            "fx": camera.fx,
            "fy": camera.fy,
            "cx": camera.cx,
            "cy": camera.cy,
            "width": camera.width,
            "height": camera.height,
            "world_from_camera": camera.world_from_camera.tolist(),
        },
    }


def _describe_sketch(ui: Ui) -> dict[str, Any] | None:
    """Describe the sketch of a scene that is being opened; None while there is none."""
    sketch = ui.session.sketches.shown
    if sketch is None:
        return None
    pose = ui.session.state.viewpoint.world_from_camera.tolist()
    return {"splats": len(sketch.document.scene), "drawn": ui.sketch_view.snapshot is not None, "pose": pose}
