"""Boxes of KITTI's raw drives: ``tracklet_labels.xml``, a box over time an item, in the LiDAR's axes."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from instdrive_core.datasets.recording import Pose
from instdrive_core.datasets.rig_files import FORWARD_X, parse_numbers, require_sizes
from instdrive_core.errors import DataError
from instdrive_core.files.json_value import require_whole_text
from instdrive_core.files.xml_file import parse_xml, read_child_text
from instdrive_core.scene.track import Track

_REMEDY = "Get the file again"


def read_tracklets(file: Path, world_from_velodyne: dict[int, Pose], times: dict[int, float]) -> tuple[Track, ...]:
    """Read the tracks of all steps whose pose is known; a tracklet has no ID but its place in the file.

    Raises DataError where the file is damaged.
    """
    root = parse_xml(file)
    holder = root.find("tracklets")
    if holder is None:
        raise DataError(file, "the element 'tracklets' is missing", _REMEDY)
    items = holder.findall("item")
    count = read_child_text(file, holder, "count", "tracklets")
    if count != str(len(items)):
        raise DataError(file, f"promises {count[:20]} tracklets and holds {len(items)}", _REMEDY)
    tracks = (_read_item(file, row, item, world_from_velodyne, times) for row, item in enumerate(items))
    return tuple(track for track in tracks if track is not None)


def _read_item(
    file: Path, row: int, item: ElementTree.Element, frames: dict[int, Pose], times: dict[int, float]
) -> Track | None:
    where = f"item[{row}]"
    words = [read_child_text(file, item, name, where) for name in ("h", "w", "l", "first_frame")]
    height, width, length, first = parse_numbers(file, words, where)
    require_sizes(file, np.array([width, length, height]), where)
    listed = item.find("poses")
    rows = [] if listed is None else listed.findall("item")
    if first != int(first) or first < 0:
        raise DataError(file, f"{where}/first_frame is {first}, expected a time step", _REMEDY)
    poses = {}
    for number, entry in enumerate(rows):
        step, place = int(first) + number, f"{where}/poses/item[{number}]"
        values = parse_numbers(
            file, [read_child_text(file, entry, name, place) for name in ("tx", "ty", "tz", "rz")], place
        )
        if step in frames:
            poses[step] = frames[step] @ place_standing_box(values[:3], float(values[3]), float(height)) @ FORWARD_X
    if not poses:
        return None
    try:
        label = require_whole_text(read_child_text(file, item, "objectType", where))
    except ValueError as error:
        raise DataError(file, f"{where}/objectType cannot be used ({error})", _REMEDY) from error
    steps = sorted(poses)
    dimensions = np.array([width, length, height])
    return Track(
        str(row), label, dimensions, np.array([times[step] for step in steps]), np.stack([poses[s] for s in steps])
    )


def place_standing_box(bottom: np.ndarray, yaw: float, height: float) -> Pose:
    """Place a box (x forward, z up) whose bottom's centre is given, turned about z."""
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    pose[:3, 3] = bottom + np.array([0, 0, height / 2])
    return pose
