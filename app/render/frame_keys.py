"""What both renderers take a frame by: keys that are equal where pictures are, when to draw drafts, and how small."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from instdrive_app.state import FrameSnapshot, ViewMode
from instdrive_core.scene.camera import Camera

SMOOTH_SECONDS = 1 / 30
"""Frames that take longer are drawn coarsely while the camera moves or the drive plays."""
DRAFT_FACTOR = 2
"""How many times fewer pixels per axis blended views have while the camera moves."""
FLAT_MODES = (ViewMode.INSTANCE, ViewMode.CODEWORD)
"""View modes that show one number a pixel, unblended."""


def make_camera_key(camera: Camera) -> tuple[Any, ...]:
    """Make a key that is equal for cameras that see the same."""
    pinhole = (camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height)
    return (*pinhole, camera.world_from_camera.tobytes(), camera.lag)


def make_snapshot_key(snapshot: FrameSnapshot) -> tuple[Any, ...]:
    """Make a key that is equal for snapshots that ask for the same frame."""
    rest = [getattr(snapshot, entry.name) for entry in fields(FrameSnapshot) if entry.name != "camera"]
    return (make_camera_key(snapshot.camera), *rest)


def round_to_figure(value: float, down: bool) -> float:
    """Round down or up to 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(max(value, 1e-3)))
    steps = [step * power for step in (1.0, 2.0, 5.0, 10.0)]
    return (
        max(step for step in steps if step <= value * 1.0001) if down else min(s for s in steps if s >= value * 0.9999)
    )
