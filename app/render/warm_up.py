"""Loads compiled kernels before they are needed: a third of a second that would freeze the first frame or click."""

from __future__ import annotations

import numpy as np

from instdrive_app.render.depth_order import sort_by_depth
from instdrive_app.render.picking import Picker
from instdrive_app.state import EditorState, resolve
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.absolute_adjustment import SetAdjustment, summarize_adjustments
from instdrive_core.edits.kinds.color import RecolorInstances
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.paint import PaintInstances
from instdrive_core.edits.kinds.select import SelectInstances
from instdrive_core.edits.queries.region import find_rows_in_region
from instdrive_core.instances.proximity import find_rows_near
from instdrive_core.instances.table import Instance
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import scene_from_gaussians

_SIDE = 16
"""Pixels."""


def warm_up() -> None:
    """Sort, pick, select a region, grow it, edit and move once, in a scene of one splat.

    Call it on a separate thread when the program starts.
    """
    state = EditorState()
    document = _build_one_splat(state.viewpoint.pivot)
    snapshot = resolve(state, _SIDE, _SIDE)
    Picker().find_instances_at(document, snapshot, _SIDE / 2, _SIDE / 2)
    sort_by_depth("warm-up", document.scene.gaussians.means, np.array([0, 0, 1, 9], np.float32), 0.2)
    find_rows_in_region(document, snapshot.camera, 0.0, np.ones((_SIDE, _SIDE), np.bool_))
    both = np.zeros((2, 3), np.float32)
    find_rows_near(both, np.zeros(1, np.int64), np.ones(1, np.int64), 1.0)
    first = np.zeros(1, np.int64)
    document.transforms.assign(first, np.array([document.transforms.add(2 * np.eye(3, 4))], np.uint16))
    document.compute_means(first)
    _edit(document)


def _edit(document: Document) -> None:
    """Recolour, adjust, move and undo once."""
    document.scene.instance_ids[:] = 1
    document.note_instances_changed(ids_changed=True)
    document.scene.table.set(Instance(1, "warm-up"))
    edits = (
        SelectInstances((1,)),
        RecolorInstances((1,), "tint", (1.0, 1.0, 1.0)),
        PaintInstances((1,), (1.0, 1.0, 1.0)),
        SetAdjustment((1,), "contrast", 2.0),
        MoveInstances((1,), (1.0, 0.0, 0.0)),
    )
    for edit in edits:
        document.apply(edit)
        document.count_states()
    summarize_adjustments(document, (1,))
    document.undo()


def _build_one_splat(place: np.ndarray) -> Document:
    shapes = {"log_scales": (3,), "sh_dc": (3,), "sh_rest": (0, 3), "features": (0,)}
    nothing = {name: np.zeros((1, *shape), np.float32) for name, shape in shapes.items()}
    upright, solid = np.array([[1, 0, 0, 0]], np.float32), np.full(1, 3, np.float32)
    gaussians = Gaussians(place[None].astype(np.float32), upright, opacity_logits=solid, **nothing)
    return Document(scene_from_gaussians(gaussians))
