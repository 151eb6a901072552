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
from instdrive_core.errors import OptionError
from instdrive_core.project.open import open_document
from instdrive_core.project.sources import SceneSources
from instdrive_core.recording.annotations import find_annotated_tracks
from instdrive_core.recording.depth_files import DepthFormat
from instdrive_core.recording.lidar import Lidar, build_sweep_caster, choose_lidar
from instdrive_core.recording.plan import RecordOptions, plan_camera_views, plan_rig_views, plan_views
from instdrive_core.recording.shutter import RollingRig, build_rolling_rig
from instdrive_core.recording.sweep_files import CastSweep
from instdrive_core.recording.things import find_moves
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.track import Track
from instdrive_core.scene.transforms import Similarity
from instdrive_core.sweeps.sensor import OWN


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
    cast_sweep: CastSweep | None = None
    """Casts the LiDAR's sweep of a moment; None where none is recorded."""
    sensor: str = ""
    """Which LiDAR that is: another one makes another recording."""
    rolling: RollingRig | None = None
    """The cameras as they move while their lines are exposed; None where all lines are exposed at once."""
    lidar: Lidar | None = None
    """What `cast_sweep` casts, to be cast from anywhere."""
    depth_format: DepthFormat = "npz"
    """How depth in metres is written, beside the pictures in millimetres."""


def open_drive(path: Path, options: RecordOptions) -> Drive:
    """Open a run, a scene folder or a project as the drive that its edits make.

    Raises DataError, SceneTooLargeError as opening a document does, OptionError for options that do not fit.
    """
    document, _ = open_document(path)
    return take_drive(document, options)


def take_drive(document: Document, options: RecordOptions) -> Drive:
    """Take a document as the drive that its edits make. Raises OptionError for options that do not fit."""
    if options.shutter is not None and options.flow:
        raise OptionError("optical flow is not known through a rolling shutter; leave out --flow or --shutter")
    edited = bake_document(document, to_read=True)
    views = plan_views(edited, options)
    annotated, note = (), ""
    run = document.open_scene.base.path if isinstance(document.open_scene, SceneSources) else None
    if run is not None:
        annotated, note = find_annotated_tracks(run, document.scene)
    is_turned = not np.array_equal(document.orientation, np.eye(3, 4))
    if annotated and is_turned:
        annotated, note = (), "the scene was turned, so boxes of standing things are fitted to their splats"
    left = np.flatnonzero(~document.state.find_mask(Flag.DELETED))
    lidar = choose_lidar(options.lidar, None if is_turned else run, document.scene, left, options.ray_drop)
    cast_sweep = build_sweep_caster(edited, lidar, plan_rig_views(edited, options)) if lidar is not None else None
    own = {view.name for view in edited.views}
    foreign = sorted({view.name for view in views} - own)
    plain = ""
    if options.exposed and foreign and edited.exposures is not None:
        plain = f"the scene's own colours are recorded of {', '.join(foreign)}: no photo says how they expose"
    notes = tuple(each for each in (note, plain, *(lidar.notes if lidar is not None else ())) if each)
    seen = Photographed(document.scene, left) if options.confidence or options.ego else None
    moves = find_moves(document)
    return Drive(
        edited,
        views,
        moves,
        annotated,
        options.exposed,
        options.flow,
        seen,
        notes,
        cast_sweep,
        options.lidar or OWN,
        None if options.shutter is None else build_rolling_rig(options.shutter, plan_camera_views(edited, options)),
        lidar,
        options.depth_format,
    )
