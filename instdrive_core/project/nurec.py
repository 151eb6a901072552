"""Handing the edits of an open document over to NVIDIA NuRec."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.errors import DataError
from instdrive_core.formats.nurec.hand_over import HandOver, plan_hand_over
from instdrive_core.formats.nurec.sequence_tracks import read_sequence_tracks
from instdrive_core.formats.nurec.writing import write_hand_over
from instdrive_core.progress import report_span
from instdrive_core.project.sources import get_sources, reopen_base


def export_hand_over(document: Document, folder: Path, tracks: Path | None = None) -> HandOver:
    """Write the edits of actors into a new folder, as NuRec's renderer takes them; returns what was written.

    Args:
        document: unchanged meanwhile; its base is opened again, as NuRec knows the drive.
        folder: gets ``edit-assets.json`` and ``external_assets``.
        tracks: NuRec's ``sequence_tracks.json`` or its ``.usdz``; None where IDs and times are the document's own.

    Raises DataError where the folder holds a hand-over already, the tracks cannot be used, the base has changed since,
    or the whole scene was turned: NuRec's world was not.
    """
    if not np.array_equal(document.orientation, np.eye(3, 4)):
        problem = "the scene was turned upright, and NuRec's reconstruction was not"
        raise DataError(get_sources(document).base.path, problem, "Undo Turn upright, and hand over again")
    known = None if tracks is None else read_sequence_tracks(tracks)
    with report_span(0.0, 0.5):
        before = reopen_base(get_sources(document).base)
    plan = plan_hand_over(before, bake_document(document, to_read=True), known)
    write_hand_over(folder, plan)
    return plan


def describe_hand_over(plan: HandOver) -> str:
    """Describe what was handed over, for the user."""
    edits = plan.edits
    counts = (("removed", edits.removed), ("replaced", edits.replaced), ("inserted", edits.inserted))
    told = ", ".join(f"{len(items)} {what}" for what, items in counts)
    untold = f". Not handed over, as NuRec edits moving objects only: {'; '.join(plan.untold)}" if plan.untold else ""
    return f"actors: {told}{untold}"
