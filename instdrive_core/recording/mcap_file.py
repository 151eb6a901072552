"""A recording as one .mcap file with Foxglove's messages: to look at in Foxglove or rerun.

Topics: ``/tf`` (cameras in the world), ``/camera/NAME/image`` and ``/camera/NAME/calibration``, ``/boxes`` (3D boxes in
the colours of the editor's instances), ``/lidar`` where the recording has sweeps.
"""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.datasets.layout_files import require_new_folder
from instdrive_core.extras import explain_missing_module
from instdrive_core.files.json_fields import read_json
from instdrive_core.maths.rotations import quaternion_from_matrix
from instdrive_core.progress import report
from instdrive_core.recording.folder import read_manifest
from instdrive_core.recording.mcap_schemas import FLOAT32, SCHEMAS, UINT32
from instdrive_core.recording.sweep_files import list_sweep_files, read_moment_sweep

FILE = "drive.mcap"
WORLD = "world"
_HIDDEN_ALPHA = 0.4
"""Opacity of boxes, so that points inside are seen."""


def write_mcap(folder: Path, out: Path) -> Path:
    """Write a finished recording as an .mcap file in a new folder; returns the file.

    Raises DataError where the recording is unfinished or the folder is not empty, MissingExtraError without the package
    mcap.
    """
    try:
        from mcap.writer import Writer
    except ModuleNotFoundError as error:
        raise explain_missing_module(error) or error from error
    manifest = read_manifest(folder)
    require_new_folder(out)
    with (out / FILE).open("wb") as file:
        writer = Writer(file)
        writer.start(profile="", library="instdrive")
        topics = _Topics(writer)
        _write_boxes(topics, folder, manifest)
        _write_sweeps(topics, folder, manifest)
        for place, entry in enumerate(manifest["views"]):
            report(place / len(manifest["views"]))
            _write_view(topics, folder, entry)
        writer.finish()
    return out / FILE


class _Topics:
    """Registers schemas and channels when they are first used."""

    def __init__(self, writer: Any) -> None:
        self._writer = writer
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    def add(self, topic: str, schema: str, time: float, message: dict[str, Any]) -> None:
        """Add a message at its time (seconds)."""
        if schema not in self._schemas:
            content = json.dumps({"title": schema} | SCHEMAS[schema]).encode()
            self._schemas[schema] = self._writer.register_schema(schema, "jsonschema", content)
        if topic not in self._channels:
            self._channels[topic] = self._writer.register_channel(topic, "json", self._schemas[schema])
        nanoseconds = _count_nanoseconds(time)
        data = json.dumps(message).encode()
        self._writer.add_message(self._channels[topic], nanoseconds, data, nanoseconds)


def _write_view(topics: _Topics, folder: Path, entry: dict[str, Any]) -> None:
    camera, time = entry["camera"], entry["time"]
    stamp, lens = _describe_time(time), entry["intrinsics"]
    pose = _describe_pose(np.array(entry["world_from_camera"], float))
    place = {"translation": pose["position"], "rotation": pose["orientation"]}
    frames = {"parent_frame_id": WORLD, "child_frame_id": camera}
    topics.add("/tf", "foxglove.FrameTransform", time, {"timestamp": stamp} | frames | place)
    matrix = [lens["fx"], 0, lens["cx"], 0, lens["fy"], lens["cy"], 0, 0, 1]
    calibration = {
        "timestamp": stamp,
        "frame_id": camera,
        "width": entry["width"],
        "height": entry["height"],
        "distortion_model": "",
        "D": [],
        "K": matrix,
        "R": [1, 0, 0, 0, 1, 0, 0, 0, 1],
        "P": [*matrix[:3], 0, *matrix[3:6], 0, *matrix[6:], 0],
    }
    topics.add(f"/camera/{camera}/calibration", "foxglove.CameraCalibration", time, calibration)
    picture = {"data": _encode((folder / entry["color"]).read_bytes()), "format": "png"}
    message = {"timestamp": stamp, "frame_id": camera} | picture
    topics.add(f"/camera/{camera}/image", "foxglove.CompressedImage", time, message)


def _write_boxes(topics: _Topics, folder: Path, manifest: dict[str, Any]) -> None:
    colors = {entry["id"]: entry["color"] for entry in manifest["instances"]}
    for moment in manifest["moments"]:
        time = moment["time"]
        entities = [_describe_box(box, colors[box["id"]], time) for box in read_json(folder / moment["file"])["boxes"]]
        clear = {"timestamp": _describe_time(time), "type": 1, "id": ""}  # 1 deletes all: things may be gone by now
        topics.add("/boxes", "foxglove.SceneUpdate", time, {"deletions": [clear], "entities": entities})


def _describe_box(box: dict[str, Any], color: list[int], time: float) -> dict[str, Any]:
    w, x, y, z = box["rotation"]
    red, green, blue = (value / 255 for value in color)
    cube = {
        "pose": {
            "position": dict(zip("xyz", box["center"], strict=True)),
            "orientation": {"x": x, "y": y, "z": z, "w": w},
        },
        "size": {"x": box["size"]["width"], "y": box["size"]["length"], "z": box["size"]["height"]},
        "color": {"r": red, "g": green, "b": blue, "a": _HIDDEN_ALPHA},
    }
    facts = {"name": box["name"], "class": box["class"], "from": box["from"], "velocity": json.dumps(box["velocity"])}
    unused = ("arrows", "spheres", "cylinders", "lines", "triangles", "texts", "models")
    return {
        "timestamp": _describe_time(time),
        "frame_id": WORLD,
        "id": str(box["id"]),
        "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": False,
        "metadata": [{"key": key, "value": value} for key, value in facts.items()],
        "cubes": [cube],
    } | {name: [] for name in unused}


def _write_sweeps(topics: _Topics, folder: Path, manifest: dict[str, Any]) -> None:
    times = {moment["step"]: moment["time"] for moment in manifest["moments"]}
    for step, path in list_sweep_files(folder, list(times)).items():
        sweep = read_moment_sweep(path)
        names = ("x", "y", "z", "intensity")
        row = np.dtype([*((name, "<f4") for name in names), ("instance", "<u4")])
        points = np.zeros(len(sweep.points), row)
        for axis, name in enumerate("xyz"):
            points[name] = sweep.points[:, axis]
        points["intensity"], points["instance"] = sweep.intensity, sweep.instances
        fields = [{"name": name, "offset": 4 * place, "type": FLOAT32} for place, name in enumerate(names)]
        message = {
            "timestamp": _describe_time(times[step]),
            "frame_id": WORLD,
            "pose": _describe_pose(np.eye(4)),
            "point_stride": row.itemsize,
            "fields": [*fields, {"name": "instance", "offset": 16, "type": UINT32}],
            "data": _encode(points.tobytes()),
        }
        topics.add("/lidar", "foxglove.PointCloud", times[step], message)


def _describe_pose(pose: Float64[ndarray, "4 4"]) -> dict[str, dict[str, float]]:
    w, x, y, z = quaternion_from_matrix(pose[:3, :3]).tolist()
    position = dict(zip("xyz", pose[:3, 3].tolist(), strict=True))
    return {"position": position, "orientation": {"x": x, "y": y, "z": z, "w": w}}


def _describe_time(time: float) -> dict[str, int]:
    seconds, nanoseconds = divmod(_count_nanoseconds(time), 10**9)
    return {"sec": seconds, "nsec": nanoseconds}


def _count_nanoseconds(time: float) -> int:
    return max(round(time * 1e9), 0)


def _encode(content: bytes) -> str:
    return base64.b64encode(content).decode("ascii")
