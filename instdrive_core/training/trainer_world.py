"""Where other trainers put the world: their scenes are moved to the world of the clip that trains on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from instdrive_core.datasets.clip import Clip
from instdrive_core.errors import DataError
from instdrive_core.formats.checkpoints.drivestudio import STEP_SECONDS
from instdrive_core.formats.checkpoints.start_step import read_start_step
from instdrive_core.formats.registry import find_format
from instdrive_core.scene.pose_transforms import rotate_sky, transform_track
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.track import Track
from instdrive_core.scene.transforms import transform_gaussians


def move_to_clip_world(scene: Scene, path: Path, clip: Clip) -> Scene:
    """Move a scene that another trainer wrote to `path`, in place, from that trainer's world to the clip's.

    drivestudio's world is the recording's frame of reference at its first step; all others are taken to be in the
    world of the photos' own files. Cameras of the scene are left out: photos are compared with the clip's. A scene
    of this program, or a plain .ply, is in the clip's world already.

    Raises DataError where the trainer's world has no known place in the clip's.
    """
    fmt = find_format(path)
    if fmt is None or not fmt.in_world_of_photos:
        return scene
    step = read_start_step(path) if fmt.folder is None else None
    if step is not None:
        return _move_from_drivestudio(scene, path, clip, step)
    if scene.actors:  # StreetGaussians' world begins at the mean of the car's places, HUGSIM's at a place of its own
        raise DataError(
            path,
            "where the world of its trainer lies in that of the clip is not known",
            "Open, edit and convert it as it is; --init takes checkpoints of drivestudio with a clip of its folders",
        )
    if clip.world_from_file is not None:
        transform_gaussians(scene.gaussians, clip.world_from_file)
    return replace(scene, views=())


def _move_from_drivestudio(scene: Scene, path: Path, clip: Clip, step: int) -> Scene:
    if step not in clip.start_poses:
        known = "has no such step" if clip.start_poses else "was not preprocessed by drivestudio"
        raise DataError(
            path,
            f"drivestudio trained it from step {step} on and put its world there; {clip.path} {known}",
            "Give the folder that it was trained on, e.g. data/waymo/processed/training/023",
        )
    pose = clip.start_poses[step].copy()
    pose[:3, 3] -= clip.origin
    matrix = pose[:3]
    background = np.flatnonzero(scene.nodes == 0)
    moved = scene.gaussians.select(background)
    transform_gaussians(moved, matrix)
    for name, array in moved.arrays().items():
        getattr(scene.gaussians, name)[background] = array
    delay = STEP_SECONDS * (step - min(clip.start_poses))
    return replace(
        scene,
        actors=tuple(_delay_track(transform_track(track, matrix), delay) for track in scene.actors),
        sky=None if scene.sky is None else rotate_sky(scene.sky, matrix[:, :3]),
        origin=clip.origin.copy(),
        views=(),
    )


def _delay_track(track: Track, seconds: float) -> Track:
    return replace(track, times=track.times + seconds)
