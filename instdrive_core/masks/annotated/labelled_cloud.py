"""Annotated LiDAR of a whole clip as one cloud: what stands still in the world, and each tracked object in its box.

One sweep leaves most pixels of a photo without a point. All sweeps together, each object's points carried into its
box frame, are dense enough to be drawn as surfaces.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, Int64, UInt8, UInt32
from numpy import ndarray
from scipy import ndimage

from instdrive_core.datasets.clip import Clip, Sweep
from instdrive_core.datasets.sweeps import SIBLING_REACH
from instdrive_core.instances.vehicles import names_vehicle
from instdrive_core.masks.ground_truth_instance import GroundTruthInstance
from instdrive_core.scene.track import Track, interpolate_tracks

MOVABLE = frozenset(
    (
        "Car",
        "Pickup Truck",
        "Medium-sized Truck",
        "Semi-truck",
        "Towed Object",
        "Other Vehicle - Construction Vehicle",
        "Other Vehicle - Uncommon",
        "Emergency Vehicle",
        "Bus",
        "Train",
        "Trolley",
        "Tram / Subway",
        "Motorcycle",
        "Other Vehicle - Pedicab",
        "Personal Mobility Device",
        "Motorized Scooter",
        "Bicycle",
        "Pedestrian",
        "Pedestrian with Object",
        "Animals - Bird",
        "Animals - Other",
    )
)
"""Semantic classes whose points belong to a cuboid; outside of one, it is not known to which object."""
ONE_SURFACE = {"Lane Line Marking": "Road", "Stop Line Marking": "Road", "Other Road Marking": "Road"}
"""Classes that are painted on another one."""
NO_SURFACE = frozenset(("Smoke", "Exhaust", "Spray or rain", "Reflection"))

UNKNOWN = 0
"""ID of points that hide what is behind them, of which object is not known."""
STATIC_VOXEL, MODEL_VOXEL = 0.1, 0.06
"""Metres: points are thinned to one per cell of this size."""
STRAY_CELL, STRAY_SHARE = 0.3, 0.1
"""Clusters of an object's points, in cells of this many metres, with less than this share of them are strays."""
CORE_SPACING = 0.15
BOX_BOTTOM = 0.12
"""Metres cut off the lower face of a box: there lies the road."""
BOX_MARGIN = 0.1


@dataclass(frozen=True)
class LabelledCloud:
    """All annotated points that may be used."""

    points: Float32[ndarray, "n 3"]
    """Points of what stands still, in the world."""
    ids: UInt32[ndarray, " n"]
    models: dict[int, Float32[ndarray, "k 3"]]
    """Points of each tracked object, in its box frame, by ID."""
    tracks: dict[int, Track]
    instances: dict[int, GroundTruthInstance]


def build_cloud(clip: Clip, held_out: bool) -> LabelledCloud:
    """Gather the annotated points of a clip's sweeps, those of held-out time steps only with `held_out`."""
    stuff = sorted({ONE_SURFACE.get(name, name) for name in clip.class_names.values()} - MOVABLE - NO_SURFACE)
    stuff_ids = {name: number + 1 for number, name in enumerate(stuff)}
    tracks = {len(stuff) + 1 + number: track for number, track in enumerate(clip.tracks)}
    id_of_class = assign_class_ids(clip.class_names, stuff_ids)
    fits = np.array([find_fitting_classes(clip.class_names, track.label) for track in clip.tracks]).reshape(-1, 256)
    static: list[tuple[ndarray, ndarray]] = []
    models: dict[int, list[ndarray]] = {number: [] for number in tracks}
    for sweep in clip.sweeps if held_out else clip.training_sweeps:
        points, ids, on_objects = _split_sweep(sweep, tracks, id_of_class, fits)
        static.append(_thin_points(points, ids, STATIC_VOXEL))
        for number, local in on_objects.items():
            models[number].append(local)
    points = np.concatenate([np.zeros((0, 3), np.float32), *(part for part, _ in static)])
    ids = np.concatenate([np.zeros(0, np.uint32), *(part for _, part in static)])
    points, ids = _thin_points(points, ids, STATIC_VOXEL)
    return LabelledCloud(
        points,
        ids,
        {number: _build_model(tracks[number], parts) for number, parts in models.items()},
        tracks,
        _list_instances(stuff_ids, tracks),
    )


def _list_instances(stuff_ids: dict[str, int], tracks: dict[int, Track]) -> dict[int, GroundTruthInstance]:
    instances = {number: GroundTruthInstance(number, name, name, "stuff") for name, number in stuff_ids.items()}
    for number, track in tracks.items():
        name = f"{track.label} {track.id[:8]}"
        instances[number] = GroundTruthInstance(number, name, track.label, "thing", track.moving, track.id)
    return instances


NOTHING = np.iinfo(np.int64).max
"""Stands for points to be left out: they are no surface, or nothing is known about them."""


def assign_class_ids(class_names: dict[int, str], stuff_ids: dict[str, int]) -> Int64[ndarray, "256"]:
    """Give each semantic class what its points are outside of all boxes: an ID, `UNKNOWN` or `NOTHING`.

    Where the clip has no classes, all points are surfaces of which nobody says what they are: sky is not behind them.
    """
    ids = np.full(256, NOTHING if class_names else UNKNOWN, np.int64)
    for number, name in class_names.items():
        if name in MOVABLE:
            ids[number] = UNKNOWN
        elif name not in NO_SURFACE:
            ids[number] = stuff_ids[ONE_SURFACE.get(name, name)]
    return ids


def find_fitting_classes(class_names: dict[int, str], label: str) -> Bool[ndarray, "256"]:
    """Find the semantic classes that points of an object with this label have; 0 is given to points that were left
    out."""
    fits = np.zeros(256, bool)
    fits[0] = True
    for number, name in class_names.items():
        fits[number] = name == label or (name in MOVABLE and label in MOVABLE)
    return fits


def _split_sweep(
    sweep: Sweep, tracks: dict[int, Track], id_of_class: Int64[ndarray, "256"], fits: Bool[ndarray, "t 256"]
) -> tuple[Float32[ndarray, "n 3"], UInt32[ndarray, " n"], dict[int, Float32[ndarray, "k 3"]]]:
    """Points and IDs of what stands still, and points by tracked object in its box frame."""
    found = sweep.load()
    classes = found.classes if found.classes is not None else np.zeros(len(found.points), np.uint8)
    numbers = np.array(sorted(number for number, track in tracks.items() if track.covers(sweep.time)), np.int64)
    boxes = [tracks[int(number)] for number in numbers]
    poses = interpolate_tracks(boxes, sweep.time)
    halves = np.array([track.dimensions / 2 for track in boxes]).reshape(-1, 3)
    moving = np.array([track.moving for track in boxes], bool)
    fitting = fits[numbers - min(tracks, default=0)].reshape(-1, 256)
    box, near_moving = assign_boxes(found.points, classes, found.sensor, poses, halves, moving, fitting)
    on_objects = {}
    for position, number in enumerate(numbers):
        members = found.points[box == position].astype(np.float64)
        if len(members):
            local = (members - poses[position, :3, 3]) @ poses[position, :3, :3]
            on_objects[int(number)] = local.astype(np.float32)
    ids = id_of_class[classes]
    kept = (box == -1) & (ids != NOTHING) & ~(near_moving & (ids == UNKNOWN))
    return found.points[kept], ids[kept].astype(np.uint32), on_objects


@numba.njit(cache=True, nogil=True, error_model="numpy")
def assign_boxes(
    points: Float32[ndarray, "n 3"],
    classes: UInt8[ndarray, " n"],
    sensors: UInt8[ndarray, " n"],
    poses: Float64[ndarray, "t 4 4"],
    halves: Float64[ndarray, "t 3"],
    moving: Bool[ndarray, " t"],
    fits: Bool[ndarray, "t 256"],
) -> tuple[Int32[ndarray, " n"], Bool[ndarray, " n"]]:
    """Assign each point to a box, and say where a moving box is near.

    A point belongs to the box in whose middle it lies the deepest, among those it is inside of and that its class
    fits; -1 = none, -2 = inside of a moving box without belonging to it. The second LiDAR's points never belong to a
    moving box: that LiDAR meets the object at another time.
    """
    box = np.full(len(points), -1, np.int32)
    near_moving = np.zeros(len(points), np.bool_)
    reach = np.empty(len(poses))
    for b in range(len(poses)):
        reach[b] = (np.sqrt((halves[b] ** 2).sum()) + SIBLING_REACH) ** 2
    for p in range(len(points)):
        deepest = 1.0
        for b in range(len(poses)):
            dx, dy = points[p, 0] - poses[b, 0, 3], points[p, 1] - poses[b, 1, 3]
            if dx * dx + dy * dy > reach[b]:
                continue
            dz = points[p, 2] - poses[b, 2, 3]
            x = abs(dx * poses[b, 0, 0] + dy * poses[b, 1, 0] + dz * poses[b, 2, 0])
            y = abs(dx * poses[b, 0, 1] + dy * poses[b, 1, 1] + dz * poses[b, 2, 1])
            z = dx * poses[b, 0, 2] + dy * poses[b, 1, 2] + dz * poses[b, 2, 2]
            if z > halves[b, 2] + SIBLING_REACH or z < -halves[b, 2]:
                continue
            if moving[b] and x < halves[b, 0] + SIBLING_REACH and y < halves[b, 1] + SIBLING_REACH:
                near_moving[p] = True
            if z > halves[b, 2] + BOX_MARGIN or z < BOX_BOTTOM - halves[b, 2]:
                continue
            depth = max(x / (halves[b, 0] + BOX_MARGIN), y / (halves[b, 1] + BOX_MARGIN))
            if depth >= deepest:
                continue
            if fits[b, classes[p]] and not (moving[b] and sensors[p] != 0):
                deepest = depth
                box[p] = b
            elif moving[b] and box[p] == -1:
                box[p] = -2
    return box, near_moving


def _thin_points(
    points: Float32[ndarray, "n 3"], ids: UInt32[ndarray, " n"], cell: float
) -> tuple[Float32[ndarray, "m 3"], UInt32[ndarray, " m"]]:
    """Thin points to one per cell, with the cell's most frequent ID."""
    if not len(points):
        return points, ids
    cells = np.floor(points / cell).astype(np.int64)
    cells -= cells.min(axis=0)
    _, sizes_y, sizes_z = cells.max(axis=0) + 1
    keys = (cells[:, 0] * sizes_y + cells[:, 1]) * sizes_z + cells[:, 2]
    pairs, first, counts = np.unique(keys * (int(ids.max()) + 1) + ids, return_index=True, return_counts=True)
    keys = pairs // (int(ids.max()) + 1)
    order = np.lexsort((-counts, keys))
    best = order[np.flatnonzero(np.diff(keys[order], prepend=-1))]
    return points[first[best]], ids[first[best]]


def _build_model(track: Track, parts: list[Float32[ndarray, "k 3"]]) -> Float32[ndarray, "m 3"]:
    """An object's points, vehicles completed by their mirror image, around a core that any such object fills."""
    points = _drop_strays(np.concatenate([np.zeros((0, 3), np.float32), *parts]))
    if names_vehicle(track.label):
        points = np.concatenate([points, points * np.array([-1, 1, 1], np.float32)])
    points, _ = _thin_points(points, np.zeros(len(points), np.uint32), MODEL_VOXEL)
    return np.concatenate([points, _build_core(track)])


def _drop_strays(points: Float32[ndarray, "n 3"]) -> Float32[ndarray, "m 3"]:
    """Drop small clusters of points apart from the rest, such as twigs above a roof."""
    if not len(points):
        return points
    cells = np.floor(points / STRAY_CELL).astype(int)
    cells -= cells.min(axis=0)
    occupied = np.zeros(cells.max(axis=0) + 1, bool)
    occupied[tuple(cells.T)] = True
    clusters = np.zeros(occupied.shape, np.int32)
    ndimage.label(occupied, np.ones((3, 3, 3)), output=clusters)
    cluster = clusters[tuple(cells.T)]
    return points[np.bincount(cluster)[cluster] >= STRAY_SHARE * len(points)]


def _build_core(track: Track) -> Float32[ndarray, "m 3"]:
    """Points inside the box where the object surely is: LiDAR misses dark paint and windows.

    Shares of the box: a vehicle's body and the part of its cabin that all kinds of vehicles have, else a trunk.
    """
    if names_vehicle(track.label):
        parts = (((-0.4, 0.4), (-0.42, 0.42), (-0.3, 0.0)), ((-0.3, 0.3), (-0.1, 0.02), (0.0, 0.36)))
    else:
        parts = (((-0.2, 0.2), (-0.2, 0.2), (-0.42, 0.4)),)
    grids = []
    for ranges in parts:
        axes = [
            np.linspace(low * size, high * size, max(2, math.ceil((high - low) * size / CORE_SPACING)))
            for (low, high), size in zip(ranges, track.dimensions.tolist(), strict=True)
        ]
        grids.append(np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3))
    return np.concatenate(grids).astype(np.float32)
