"""Where a scene lies in the world of a clip: the places that it may have there, and moving it to one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.datasets.clip import Clip
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.pose_transforms import rotate_sky, transform_track, transform_view
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.transforms import (
    Similarity,
    compose_transforms,
    extract_scale,
    transform_gaussians,
)

_FEWEST_CAMERAS = 2
_ALIKE = 1e-6


def list_placements(scene: Scene, clip: Clip, orientation: Similarity) -> list[Similarity]:
    """List the places that a scene may have among a clip's photos, as [s R | t] from its coordinates to the clip's.

    They are: where it lies as it is, also where its file has lost the clip's origin, each of them with and without the
    user's turns; where the photos' own files have their world; where drivestudio's training from the clip's first step
    has it; and where the cameras that the scene knows of the same photos are. Equal ones are listed once.

    Args:
        scene: as its file has it.
        clip: the photos.
        orientation: the turns of the whole scene by edits, from the file's axes to those shown.
    """
    shift = np.c_[np.eye(3), scene.origin - clip.origin]
    places = [shift, np.eye(3, 4), compose_transforms(shift, orientation), orientation]
    if clip.world_from_file is not None:
        to_clip = np.c_[np.eye(3), -clip.origin]
        from_file = compose_transforms(clip.world_from_file, np.c_[np.eye(3), scene.origin])
        places.append(compose_transforms(to_clip, from_file))
    if clip.start_poses:
        start = clip.start_poses[min(clip.start_poses)][:3]
        places.append(np.c_[start[:, :3], start[:, 3] - clip.origin])
    by_cameras = align_cameras(scene.views, tuple(frame.view for frame in clip.frames))
    if by_cameras is not None:
        places.append(by_cameras)
    distinct: list[Similarity] = []
    for place in places:
        if not any(np.allclose(place, other, rtol=_ALIKE, atol=_ALIKE) for other in distinct):
            distinct.append(place)
    return distinct


def align_cameras(views: tuple[CameraView, ...], others: tuple[CameraView, ...]) -> Similarity | None:
    """Find the [s R | t] that moves cameras onto others of the same photos; None where they share no two photos apart.

    The rotation is that of the cameras, as those of a drive stand on a line, which leaves the roll open. Photos are the
    same where their files have the same name, which must be unique on both sides.
    """
    ours, theirs = _name_views(views), _name_views(others)
    names = sorted(ours.keys() & theirs.keys())
    if len(names) < _FEWEST_CAMERAS:
        return None
    here = np.stack([ours[name].camera.world_from_camera for name in names])
    there = np.stack([theirs[name].camera.world_from_camera for name in names])
    left, _, right = np.linalg.svd(np.einsum("nij,nkj->ik", there[:, :3, :3], here[:, :3, :3]))
    rotation = left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right
    spread_here, spread_there = _measure_spread(here[:, :3, 3]), _measure_spread(there[:, :3, 3])
    if min(spread_here, spread_there) < _ALIKE:
        return None
    linear = spread_there / spread_here * rotation
    return np.c_[linear, there[:, :3, 3].mean(axis=0) - linear @ here[:, :3, 3].mean(axis=0)]


def place_scene(scene: Scene, matrix: Similarity, origin: Float64[ndarray, "3"]) -> Scene:
    """Copy a scene to another world, by [s R | t] from its coordinates to those that begin at `origin`.

    Splats of actors, which live in their boxes, only change their size.
    """
    gaussians, scale = scene.gaussians.copy(), extract_scale(matrix)
    if not np.array_equal(matrix, np.eye(3, 4)):
        still, driving = np.flatnonzero(scene.nodes == 0), np.flatnonzero(scene.nodes)
        for rows, change in ((still, matrix), (driving, np.c_[scale * np.eye(3), np.zeros(3)])):
            part = gaussians.select(rows)
            transform_gaussians(part, change)
            for name, array in part.arrays().items():
                getattr(gaussians, name)[rows] = array
    return replace(
        scene,
        gaussians=gaussians,
        actors=tuple(transform_track(track, matrix) for track in scene.actors),
        sky=None if scene.sky is None else rotate_sky(scene.sky, matrix[:, :3] / scale),
        views=tuple(transform_view(view, matrix) for view in scene.views),
        origin=origin.copy(),
    )


def _name_views(views: tuple[CameraView, ...]) -> dict[str, CameraView]:
    """Views by the names of their photos' files; names that occur twice are left out."""
    names = [Path(view.photo).name if view.photo else "" for view in views]
    return {name: view for name, view in zip(names, views, strict=True) if name and names.count(name) == 1}


def _measure_spread(points: Float64[ndarray, "n 3"]) -> float:
    return float(np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean()))
