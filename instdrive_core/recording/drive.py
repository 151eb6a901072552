"""A drive to be recorded: the edited scene, its views, and what is known of its things."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Int64
from numpy import ndarray

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.project.open import open_document
from instdrive_core.project.sources import SceneSources
from instdrive_core.recording.annotations import find_annotated_tracks
from instdrive_core.recording.plan import RecordOptions, plan_views
from instdrive_core.recording.things import find_moves
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.track import Track
from instdrive_core.scene.transforms import Similarity


@dataclass(frozen=True)
class Photographed:
    """The scene as the photos saw it: nothing deleted, everything in its place."""

    scene: Scene
    rows: Int64[ndarray, " n"]
    """Row there of each splat of the edited scene."""


@dataclass(frozen=True)
class Drive:
    """An edited scene as it is recorded."""

    scene: Scene
    """The edited scene, with its tracks."""
    views: tuple[CameraView, ...]
    """By time step, then by camera."""
    moves: Mapping[int, Similarity] | None = None
    """How edits moved instances, as `find_moves` gives it."""
    annotated: tuple[Track, ...] = ()
    """Boxes of the drive's annotations, for what stands still."""
    exposed: bool = False
    """Whether colours get the exposures of the training photos, where the scene knows them."""
    flow: bool = False
    """Whether optical flow is recorded."""
    photographed: Photographed | None = None
    """What photos saw of the scene, where confidence is recorded."""
    notes: tuple[str, ...] = ()
    """What the user should know."""


def open_drive(path: Path, options: RecordOptions) -> Drive:
    """Open a run, a scene folder or a project as the drive that its edits make.

    Raises DataError, SceneTooLargeError as opening a document does, OptionError for options that do not fit.
    """
    document, _ = open_document(path)
    return take_drive(document, options)


def take_drive(document: Document, options: RecordOptions) -> Drive:
    """Take a document as the drive that its edits make. Raises OptionError for options that do not fit."""
    edited = bake_document(document, to_read=True)
    views = plan_views(edited, options)
    annotated, note = (), ""
    if isinstance(document.open_scene, SceneSources):
        annotated, note = find_annotated_tracks(document.open_scene.base.path, document.scene)
    if annotated and not np.array_equal(document.orientation, np.eye(3, 4)):
        annotated, note = (), "the scene was turned, so boxes of standing things are fitted to their splats"
    notes = (note,) if note else ()
    left = document.state.find_mask(Flag.DELETED)
    seen = Photographed(document.scene, np.flatnonzero(~left)) if options.confidence or options.ego else None
    moves = find_moves(document)
    return Drive(edited, views, moves, annotated, options.exposed, options.flow, seen, notes)
