"""Which pixels of an edited street show what some training photo of the street saw, before it was edited."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray

from instdrive_core.datasets.clip import Clip
from instdrive_core.datasets.synthetic.sensors.raytrace import RayScene
from instdrive_core.datasets.synthetic.world.street import Street
from instdrive_core.scene.camera import Camera, CameraView

_STRIDE = 4
"""One pixel of so many, along rows and along columns, stands for those around it."""
_SLACK = 0.02
"""Metres before a point at which a ray may end that reaches it."""


def find_seen_pixels(
    street: Street, edited: Street, clip: Clip, views: Sequence[CameraView], changed: Sequence[Bool[ndarray, "h w"]]
) -> list[Bool[ndarray, "h w"]]:
    """Find for each view of the edited street the pixels whose point a training photo shows, wherever it was then.

    Args:
        street: as it was photographed.
        edited: with the same actors, some of them elsewhere.
        clip: whose photos train.
        views: of the edited street, in the clip's world.
        changed: pixels that are asked about, one map a view; others are False.
    """
    numbers = {street.actor_id(number): number for number in range(len(street.actors))}
    points, owners, places = [], [], []
    for number, (view, asked) in enumerate(zip(views, changed, strict=True)):
        rows, columns = np.nonzero(asked[::_STRIDE, ::_STRIDE])
        found, ids = hit_pixels(
            edited, place_camera(street, clip, view.camera), view.time, rows * _STRIDE, columns * _STRIDE
        )
        owner = np.array([numbers.get(one, -1) for one in ids.tolist()], np.int64)
        for actor in set(owner[owner >= 0].tolist()):
            inverse = np.linalg.inv(edited.box_pose(edited.actors[actor], view.time))
            found[owner == actor] = found[owner == actor] @ inverse[:3, :3].T + inverse[:3, 3]
        points.append(found)
        owners.append(np.where(ids > 0, owner, -2))  # the sky is always seen
        places.append(np.c_[np.full(len(rows), number), rows, columns])
    joined, owner = np.concatenate(points), np.concatenate(owners)
    seen = owner == -2
    photos = sorted((frame.view for frame in clip.training_frames), key=lambda view: view.time)
    for time, group in groupby(photos, key=lambda view: view.time):
        rays, now = RayScene(street.geometry(time).mesh.corners), joined.copy()
        for actor in set(owner[owner >= 0].tolist()):
            pose = street.box_pose(street.actors[actor], time)
            now[owner == actor] = joined[owner == actor] @ pose[:3, :3].T + pose[:3, 3]
        for view in group:
            camera, missing = place_camera(street, clip, view.camera), np.flatnonzero(~seen)
            seen[missing[_reaches(rays, camera, now[missing])]] = True
    maps = []
    of_view = np.concatenate(places)
    for number, asked in enumerate(changed):
        mine = of_view[:, 0] == number
        coarse = np.zeros(asked[::_STRIDE, ::_STRIDE].shape, bool)
        coarse[of_view[mine, 1], of_view[mine, 2]] = seen[mine]
        whole = np.repeat(np.repeat(coarse, _STRIDE, 0), _STRIDE, 1)[: asked.shape[0], : asked.shape[1]]
        maps.append(whole & asked)
    return maps


def place_camera(street: Street, clip: Clip, camera: Camera) -> Camera:
    """Pose a camera of a clip's world in the street's own frame."""
    pose = camera.world_from_camera.copy()
    pose[:3, 3] += clip.origin
    return replace(camera, world_from_camera=np.linalg.inv(street.world_from_street()) @ pose)


def hit_pixels(
    street: Street, camera: Camera, time: float, rows: Int64[ndarray, " n"], columns: Int64[ndarray, " n"]
) -> tuple[Float64[ndarray, "n 3"], Int64[ndarray, " n"]]:
    """What the middles of pixels show: points in the street's frame, and their instances; 0 for the sky."""
    geometry = street.geometry(time)
    local = np.c_[(columns + 0.5 - camera.cx) / camera.fx, (rows + 0.5 - camera.cy) / camera.fy, np.ones(len(rows))]
    directions = local / np.linalg.norm(local, axis=1, keepdims=True) @ camera.world_from_camera[:3, :3].T
    origins = np.tile(camera.position, (len(rows), 1))
    hits = RayScene(geometry.mesh.corners).find_first_hits(origins.astype(np.float32), directions.astype(np.float32))
    struck = hits.triangles >= 0
    ids = np.where(struck, geometry.instances[np.maximum(hits.triangles, 0)], 0).astype(np.int64)
    return origins + np.where(struck, hits.distances, 0.0)[:, None] * directions, ids


def _reaches(rays: RayScene, camera: Camera, points: Float64[ndarray, "n 3"]) -> Bool[ndarray, " n"]:
    """Whether points are in a picture, with nothing before them."""
    framed = camera.contains(*camera.project(points), 0.1)
    rows = np.flatnonzero(framed)
    if not len(rows):
        return framed
    offsets = points[rows] - camera.position
    distances = np.linalg.norm(offsets, axis=1)
    origins = np.tile(camera.position, (len(rows), 1)).astype(np.float32)
    hits = rays.find_first_hits(origins, (offsets / distances[:, None]).astype(np.float32))
    framed[rows] = (hits.triangles < 0) | (hits.distances >= distances - _SLACK)
    return framed
