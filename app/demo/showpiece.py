"""Choosing a camera and objects for demonstrations: those that show a scene best."""

from __future__ import annotations

import numpy as np
from jaxtyping import UInt32
from numpy import ndarray

from instdrive_app import camera
from instdrive_app.render.frame_renderer import FrameRenderer
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.state import resolve
from instdrive_core.instances.table import Instance
from instdrive_core.instances.vehicles import is_vehicle
from instdrive_core.scene.scene import Scene

THING_METRES = (0.8, 14.0)
"""Limits of the longest side of an object's box, metres; surfaces and buildings are larger."""
MAX_SHARE = 0.35
"""Largest share of the picture that an object may cover; larger ones are too near for a good picture."""
TRIED_VIEWS, TRIED_WIDTH = 24, 320


def choose_showpiece_view(renderer: FrameRenderer, session: EditorSession) -> int:
    """Choose, among evenly spread dataset views, the index of the one whose two largest objects are largest."""
    assert session.document is not None
    scene, before = session.document.scene, session.state
    tried = np.unique(np.linspace(0, len(scene.views) - 1, min(TRIED_VIEWS, len(scene.views))).round().astype(int))
    scores = {}
    for index in tried.tolist():
        view = scene.views[index]
        before.time, before.viewpoint = view.time, camera.view_from_camera(view)
        height = max(1, round(TRIED_WIDTH * view.camera.height / view.camera.width))
        ids = renderer.read_instance_ids(resolve(before, TRIED_WIDTH, height))
        areas = [int((ids == thing).sum()) for thing in rank_objects(scene, ids)[:2]]
        scores[index] = (len(areas), float(np.prod(areas)), len(np.unique(ids)))
    return max(scores, key=lambda index: scores[index])


def rank_objects(scene: Scene, ids: UInt32[ndarray, "h w"]) -> list[int]:
    """Rank visible instances that can be objects: cars before others, then by area in the picture."""
    present, areas = np.unique(ids[ids > 0], return_counts=True)
    share = dict(zip(present.tolist(), (areas / ids.size).tolist(), strict=True))
    things = [scene.table[i] for i in share if i in scene.table and share[i] <= MAX_SHARE]
    things = [thing for thing in things if is_car(thing) or is_object_sized(thing)]
    return [thing.id for thing in sorted(things, key=lambda thing: (is_car(thing), share[thing.id]), reverse=True)]


def is_car(instance: Instance) -> bool:
    """Whether an instance is a vehicle, by its class, or by its name where the class is unknown."""
    return is_vehicle(instance)


def is_object_sized(instance: Instance) -> bool:
    """Whether an instance's box has the size of an object in a street."""
    low, high = np.array(instance.bounds[0]), np.array(instance.bounds[1])
    return THING_METRES[0] <= float((high - low).max()) <= THING_METRES[1]
