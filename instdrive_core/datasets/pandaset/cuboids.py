"""PandaSet's cuboids as tracks."""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.datasets.pandaset.lidar import FARTHEST, find_numbered_pickle
from instdrive_core.datasets.twins import merge_twins
from instdrive_core.errors import DataError
from instdrive_core.files.json_value import require_whole_text
from instdrive_core.files.restricted_pickle import read_pickle
from instdrive_core.scene.track import Track

MOVING_PATH_LENGTH = 1.0
"""Metres: what travels farther within the clip is moving."""

_NUMBERS = ("position.x", "position.y", "position.z", "dimensions.x", "dimensions.y", "dimensions.z", "yaw")


@dataclass(frozen=True)
class _Cuboid:
    uuid: str
    label: str
    index: int
    position: Float64[ndarray, "3"]
    dimensions: Float64[ndarray, "3"]
    yaw: float
    sensor: int
    """-1, or for a moving object in the overlap of the LiDARs the one that it was annotated in."""
    sibling: str
    """uuid of the same object in the other LiDAR; '-' where there is none."""


def load_tracks(
    folder: Path, indices: range, times: list[float], origin: Float64[ndarray, "3"]
) -> tuple[tuple[Track, ...], tuple[str, ...]]:
    """Load the tracks of the cuboids in the given time steps, relative to `origin`, each object once, and notes for the
    user.

    An object that moves where both LiDARs see it is annotated twice, as siblings with different uuids, each where that
    LiDAR met it. Siblings become one track; in each step the spinning LiDAR's cuboid is taken if there is one, because
    the cameras fire while that LiDAR points their way. Some versions of the annotations name few siblings or none:
    tracks that lie in each other all the way are merged as well. Where the cuboids' LiDAR is not told either, the pose
    of the longer track is kept.

    Raises DataError where a file is damaged.
    """
    cuboids = [cuboid for index in indices for cuboid in _load_cuboids(folder, index)]
    identity = _merge_siblings(cuboids)
    by_object: dict[str, dict[int, _Cuboid]] = defaultdict(dict)
    for cuboid in sorted(cuboids, key=lambda cuboid: (cuboid.sensor == 1, cuboid.uuid != identity[cuboid.uuid])):
        by_object[identity[cuboid.uuid]].setdefault(cuboid.index, cuboid)
    tracks = tuple(_build_track(uuid, by_object[uuid], times, origin) for uuid in sorted(by_object))
    second = {uuid for uuid, found in by_object.items() if all(cuboid.sensor == 1 for cuboid in found.values())}
    twins = merge_twins(tracks, lambda track: track.id in second)
    note = twins.note()
    # A pair that stands still does not move for lying a hand's breadth apart.
    whole = tuple(replace(track, moving=track.compute_path_length() > MOVING_PATH_LENGTH) for track in twins.tracks)
    return whole, () if note is None else (note,)


def _load_cuboids(folder: Path, index: int) -> list[_Cuboid]:
    file = find_numbered_pickle(folder, index)
    if file is None:
        return []
    table = read_pickle(file)
    for name in ("uuid", "label", *_NUMBERS):
        if name not in table:
            raise DataError(file, f"the column '{name}' is missing, found {', '.join(table)}", "Get the file again")
    count = len(table["uuid"])
    try:
        values = np.stack([table[name].astype(np.float64) for name in _NUMBERS], axis=1)
    except (TypeError, ValueError) as error:
        raise DataError(
            file, f"a cuboid's position, size or yaw is no number ({error})", "Get the file again"
        ) from error
    # Written so that NaN fails too.
    wrong = ~(np.abs(values) < FARTHEST).all(axis=1) | (values[:, 3:6] <= 0).any(axis=1)
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        raise DataError(file, f"row {row} has no usable position, size or yaw: {values[row]}", "Get the file again")
    sensors = table.get("cuboids.sensor_id", np.full(count, -1))
    siblings = table.get("cuboids.sibling_id", np.full(count, "-", object))
    try:
        return [
            _Cuboid(
                require_whole_text(table["uuid"][row]),
                require_whole_text(table["label"][row]),
                index,
                values[row, :3],
                values[row, 3:6],
                float(values[row, 6]),
                int(sensors[row]),
                require_whole_text(siblings[row]),
            )
            for row in range(count)
        ]
    except (TypeError, ValueError, OverflowError) as error:
        problem = f"a cuboid's uuid, label, sensor or sibling cannot be used ({error})"
        raise DataError(file, problem, "Get the file again") from error


def _merge_siblings(cuboids: list[_Cuboid]) -> dict[str, str]:
    """Choose the uuid that stands for each uuid's object: of siblings the spinning LiDAR's, else the first by name."""
    sensors: dict[str, set[int]] = defaultdict(set)
    for cuboid in cuboids:
        sensors[cuboid.uuid].add(cuboid.sensor)
    identity = {uuid: uuid for uuid in sensors}

    def root(uuid: str) -> str:
        while identity[uuid] != uuid:
            uuid = identity[uuid]
        return uuid

    for cuboid in cuboids:
        if cuboid.sibling in identity:
            pair = {root(cuboid.uuid), root(cuboid.sibling)}
            kept = min(pair, key=lambda uuid: (sensors[uuid] == {1}, uuid))
            for uuid in pair:
                identity[uuid] = kept
    return {uuid: root(uuid) for uuid in identity}


def _build_track(uuid: str, cuboids: dict[int, _Cuboid], times: list[float], origin: Float64[ndarray, "3"]) -> Track:
    indices = sorted(cuboids)
    poses = np.tile(np.eye(4), (len(indices), 1, 1))
    for pose, index in zip(poses, indices, strict=True):
        cuboid = cuboids[index]
        cosine, sine = np.cos(cuboid.yaw), np.sin(cuboid.yaw)
        pose[:2, :2] = [[cosine, -sine], [sine, cosine]]
        pose[:3, 3] = cuboid.position - origin
    track = Track(
        id=uuid,
        label=Counter(cuboid.label for cuboid in cuboids.values()).most_common(1)[0][0],
        dimensions=np.median([cuboid.dimensions for cuboid in cuboids.values()], axis=0),
        times=np.array([times[index] for index in indices]),
        world_from_box=poses,
    )
    moving = track.compute_path_length() > MOVING_PATH_LENGTH
    return Track(track.id, track.label, track.dimensions, track.times, track.world_from_box, moving)
