"""Estimating which way is up in a document as it is now."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from instdrive_core.edits.document.document import Document
from instdrive_core.scene.scene import scene_from_gaussians
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.transforms import copy_transformed
from instdrive_core.scene.up_estimate import LOOKED_AT, UpEstimate, estimate_up
from instdrive_core.scene.upright import UP, Axis, compute_axis_direction


def estimate_document_up(document: Document, stated: Axis | None = None) -> UpEstimate:
    """Estimate which way is up, with all edits done; `stated` is what the format of the scene's file says.

    What was turned before, and says nothing itself, is taken to stand as it should.
    """
    scene = document.scene
    rows = np.flatnonzero((scene.nodes == 0) & ((document.state.flags & Flag.DELETED) == 0))
    part = copy_transformed(scene.gaussians, document.transforms, rows[:: 1 + len(rows) // LOOKED_AT])
    looked_at = replace(scene_from_gaussians(part), views=scene.views, table=scene.table)
    untouched = np.array_equal(document.orientation, np.eye(3, 4))
    found = estimate_up(looked_at, stated if untouched else None)
    return found if found.confident or untouched else UpEstimate(compute_axis_direction(UP), False, found.reason)
