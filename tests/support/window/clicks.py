"""Clicks at random places of a picture, held against the frame that the core draws of it."""

import numpy as np

from instdrive_app.render.picking import Picker
from instdrive_core.rasterize.scene_view import view_scene


def clicks_that_miss(document, snapshot, count):
    """How many of `count` clicks find another instance than that of the frame's winner."""
    picker, camera = Picker(), snapshot.camera
    frame = view_scene(document.scene, camera, snapshot.time)
    rng = np.random.default_rng(4)
    wrong = 0
    for x, y in zip(rng.integers(0, camera.width, count), rng.integers(0, camera.height, count), strict=True):
        winner = frame.winner[y, x]
        expected = int(document.scene.instance_ids[winner]) if winner >= 0 else 0
        below = picker.find_instances_at(document, snapshot, float(x), float(y))
        wrong += (below[0] if below else 0) != expected
    return wrong
