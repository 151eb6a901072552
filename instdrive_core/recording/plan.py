"""What is recorded: which cameras at which moments, from where, how large."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.frame_range import build_range_test, describe_steps
from instdrive_core.errors import OptionError
from instdrive_core.masks.export.id_maps import choose_views
from instdrive_core.recording.camera_rig import mount_cameras, read_camera_rig
from instdrive_core.recording.depth_files import DepthFormat
from instdrive_core.recording.ego_path import EgoChange, reroute_views
from instdrive_core.recording.shutter import Shutter
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.scene import Scene

LEAST_WIDTH, LARGEST = 8, 16384
"""Pixels that pictures may be wide."""


@dataclass(frozen=True)
class RecordOptions:
    """Which part of the drive is recorded, and how large its pictures are."""

    cameras: tuple[str, ...] = ()
    """Names of cameras; all by default."""
    first: int | str | None = None
    """First time step, e.g. 30, or seconds since the drive's first, e.g. 3s."""
    last: int | str | None = None
    """Last time step or second, inclusive."""
    width: int | None = None
    """Pixels; default: as in training. The height follows."""
    exposed: bool = False
    """Whether colours get the exposures of the training photos; else they are the scene's own, as in the editor."""
    flow: bool = False
    """Whether optical flow is recorded."""
    ego: tuple[EgoChange, ...] = ()
    """Changes of the recording car's way; with any, confidence is recorded, too."""
    confidence: bool = False
    """Whether confidence maps are recorded."""
    lidar: str | None = None
    """`own`, `none`, a sensor's name or a JSON file; None: the clip's own where its sweeps are at hand."""
    shutter: Shutter | None = None
    """How cameras expose their lines; None: all at once."""
    rig: Path | None = None
    """JSON file of the cameras that record; None: the drive's own."""
    ray_drop: bool = False
    """Whether surfaces lose rays of the LiDAR as often as in the clip's own sweeps."""
    depth_format: DepthFormat = "npz"
    """How depth in metres is written, beside the pictures in millimetres."""


def plan_views(scene: Scene, options: RecordOptions) -> tuple[CameraView, ...]:
    """Plan the views that are recorded, by time step and then by camera, at the asked size.

    Raises OptionError where the scene keeps no photo cameras, a camera is unknown, no moment lies in the asked part, or
    the size is unusable; DataError for a file of cameras that is wrong.
    """
    views = plan_camera_views(scene, options)
    names = tuple(dict.fromkeys(view.name for view in views))
    unknown = [name for name in options.cameras if name not in names]
    if unknown:
        raise OptionError(
            f"the {'scene' if options.rig is None else 'rig'} has no camera {unknown[0]!r}; it has {', '.join(names)}"
        )
    asked = options.cameras or names
    times = {view.index: view.time for view in views}
    is_asked = build_range_test(ClipOptions(first_frame=options.first, last_frame=options.last), times)
    chosen = [view for view in views if view.name in asked and is_asked(view.index)]
    if not chosen:
        raise OptionError(f"no photo lies in the chosen part; there are the time steps {describe_steps(times)}")
    if options.width is not None and not LEAST_WIDTH <= options.width <= LARGEST:
        raise OptionError(f"the width is {options.width}; it must be from {LEAST_WIDTH} to {LARGEST} pixels")
    chosen.sort(key=lambda view: (view.index, names.index(view.name)))
    if options.width is None:
        return tuple(chosen)
    return tuple(replace(view, camera=view.camera.scale(options.width / view.camera.width)) for view in chosen)


def plan_camera_views(scene: Scene, options: RecordOptions) -> tuple[CameraView, ...]:
    """Plan the views of the recording cameras at all moments, on the way that is recorded, in their own size.

    Raises DataError for a file of cameras that is wrong.
    """
    views = plan_rig_views(scene, options)
    if options.rig is None:
        return views
    return mount_cameras(options.rig, views, read_camera_rig(options.rig))


def plan_rig_views(scene: Scene, options: RecordOptions) -> tuple[CameraView, ...]:
    """Plan the views of the drive's cameras at all moments, on the way that is recorded: where the car is.

    All cameras and the LiDAR of a recorded drive look at the same instant.
    """
    views = [replace(view, camera=replace(view.camera, lag=None)) for view in choose_views(scene)]
    return tuple(reroute_views(views, options.ego, scene.origin))


def describe_view(view: CameraView) -> dict[str, Any]:
    """Describe a view as JSON values that read back as the same numbers."""
    camera = view.camera
    return {
        "camera": view.name,
        "step": view.index,
        "time": view.time,
        "held_out": view.held_out,
        "width": camera.width,
        "height": camera.height,
        "intrinsics": {"fx": camera.fx, "fy": camera.fy, "cx": camera.cx, "cy": camera.cy},
        "world_from_camera": camera.world_from_camera.tolist(),
    }


def compute_fingerprint(scene: Scene) -> str:
    """Compute a fingerprint of all that pictures of a scene depend on: another one means another recording."""
    digest = hashlib.blake2b(digest_size=16)
    arrays = [*scene.gaussians.arrays().values(), scene.instance_ids, scene.nodes, scene.origin]
    for track in scene.actors:
        arrays += [track.times, track.world_from_box, track.dimensions]
    if scene.sky is not None:
        arrays += [value for value in vars(scene.sky).values() if isinstance(value, np.ndarray)]
    for array in arrays:
        digest.update(repr((array.shape, array.dtype.str)).encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    for instance in scene.table:
        digest.update(repr((instance.id, instance.name, instance.class_name)).encode())
    return digest.hexdigest()
