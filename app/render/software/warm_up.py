"""Loads the CPU renderer's compiled kernels while a scene is being read, which saves a second until its picture."""

from __future__ import annotations

import threading
from dataclasses import replace

import numpy as np

from instdrive_app.render.software.draw import FrameRequest, SoftwareDraw
from instdrive_app.render.software.scene import SceneWatcher
from instdrive_app.state import EditorState, ViewMode, resolve
from instdrive_core.edits.document.document import Document
from instdrive_core.scene.gaussians import create_empty_gaussians
from instdrive_core.scene.scene import scene_from_gaussians
from instdrive_core.scene.sky import Sky

_SIDE = 16
"""Pixels."""


def start_warm_up() -> threading.Thread:
    """Start warming up on another thread and return that thread; nobody has to wait for it."""
    thread = threading.Thread(target=warm_up_software, name="software-warm-up", daemon=True)
    thread.start()
    return thread


def warm_up_software() -> None:
    """Draw an empty scene in every view mode, with and without sky, and as drafts."""
    scene = scene_from_gaussians(create_empty_gaussians())
    scene.sky = Sky(np.zeros((6, 2, 2, 3), np.float32))
    state, draw = SceneWatcher(Document(scene)).take_state(), SoftwareDraw()
    sharp = resolve(EditorState(hovered=1), _SIDE, _SIDE)
    ways = [replace(sharp, view_mode=mode) for mode in ViewMode]
    draft = replace(sharp, draft=True)
    for snapshot in (*ways, replace(sharp, show_sky=False), draft):
        draw(FrameRequest(state, snapshot))
    detailed = SoftwareDraw(fewest=-1)
    detailed(FrameRequest(state, draft))
    detailed.wait_for_detail()
    detailed(FrameRequest(state, replace(draft, show_sky=False)))


if __name__ == "__main__":
    warm_up_software()
