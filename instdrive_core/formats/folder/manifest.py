"""The part of a scene that is not an array, as JSON values, and back."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from numpy import ndarray

from instdrive_core.files.json_value import require_whole_text
from instdrive_core.formats.folder.arrays import EXTRA
from instdrive_core.formats.ply.columns import check_extra_column
from instdrive_core.instances.table import Instance, InstanceTable, compute_middle_bounds, find_main_nodes
from instdrive_core.maths.vectors import to_vector
from instdrive_core.scene.camera import Camera, CameraView, PhotoLag
from instdrive_core.scene.exposure import Exposures
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.seen_moving import SeenMover, Sighting
from instdrive_core.scene.sky import Sky
from instdrive_core.scene.track import Track


def build_manifest(scene: Scene) -> dict[str, Any]:
    """Describe a scene as JSON values: all but its arrays (Gaussians, IDs, poses, sky, exposures)."""
    return {
        "origin": scene.origin.tolist(),
        "code_bits": scene.code_bits,
        "antialiased": scene.antialiased,
        "instances": [_describe_instance(instance) for instance in scene.table],
        "actors": [_describe_track(actor) for actor in scene.actors],
        "views": [_describe_view(view) for view in scene.views],
        "seen_moving": [_describe_mover(mover) for mover in scene.seen_movers],
        "exposures": None if scene.exposures is None else list(scene.exposures.keys),
    }


def _describe_instance(instance: Instance) -> dict[str, Any]:
    return {
        "id": instance.id,
        "name": instance.name,
        "class": instance.class_name,
        "node": instance.node,
        "codeword": instance.codeword,
        "count": instance.count,
        "bounds": instance.bounds,
    }


def _describe_track(actor: Track) -> dict[str, Any]:
    return {
        "id": actor.id,
        "label": actor.label,
        "moving": bool(actor.moving),
        "dimensions": np.asarray(actor.dimensions, np.float64).tolist(),
        "steps": len(actor.times),
    }


def _describe_view(view: CameraView) -> dict[str, Any]:
    camera = view.camera
    return {
        "name": view.name,
        "index": int(view.index),
        "time": float(view.time),
        "photo": view.photo,
        "held_out": bool(view.held_out),
        "width": int(camera.width),
        "height": int(camera.height),
        "intrinsics": [float(value) for value in (camera.fx, camera.fy, camera.cx, camera.cy)],
        **({} if camera.lag is None else {"lag": asdict(camera.lag)}),
    }


def _describe_mover(mover: SeenMover) -> dict[str, Any]:
    sightings = [{"step": int(sighting.step), "box": list(sighting.box)} for sighting in mover.sightings]
    return {"camera": mover.camera, "label": mover.label, "sightings": sightings}


def assemble_scene(manifest: dict[str, Any], arrays: dict[str, ndarray]) -> Scene:
    """Assemble a scene. Raises KeyError, TypeError or ValueError where manifest and arrays do not fit."""
    gaussians = Gaussians(**{name: _get_floats(arrays, name) for name in Gaussians.__dataclass_fields__})
    instance_ids = _get_integers(arrays, "instance_ids", np.uint32)
    nodes = _get_integers(arrays, "nodes", np.uint16)
    table = _parse_table(manifest["instances"], instance_ids, gaussians.means, nodes)
    unlisted = set(np.unique(instance_ids).tolist()) - {0} - set(table.instances)
    if unlisted:
        raise ValueError(f"instance {min(unlisted)} is carried by Gaussians but missing from 'instances'")
    return Scene(
        gaussians=gaussians,
        instance_ids=instance_ids,
        codewords=_get_integers(arrays, "codewords", np.uint32),
        nodes=nodes,
        table=table,
        actors=_parse_tracks(manifest["actors"], arrays),
        sky=_parse_sky(arrays["sky"]) if "sky" in arrays else None,
        views=_parse_views(manifest["views"], arrays),
        origin=_check_shape(np.array(manifest["origin"], np.float64), (3,), "origin"),
        code_bits=int(manifest["code_bits"]),
        antialiased=_is_antialiased(manifest.get("antialiased", False)),
        extra=_parse_extra_columns(arrays),
        exposures=_parse_exposures(manifest.get("exposures"), arrays),
        seen_movers=tuple(_parse_mover(entry) for entry in manifest.get("seen_moving", [])),
    )


def _parse_table(entries: list[dict[str, Any]], ids: ndarray, means: ndarray, nodes: ndarray) -> InstanceTable:
    """Parse the list of instances; each gets the node that most of its Gaussians belong to, whatever the list says."""
    table = InstanceTable()
    for entry in entries:
        table.set(_parse_instance(entry))
    if len(ids) != len(nodes) or len(ids) != len(means):
        return table  # the scene says what is wrong
    rows = np.flatnonzero(np.isin(ids, np.unique(ids[nodes > 0])))
    main = find_main_nodes(ids[rows], nodes[rows])
    for listed in [listed for listed in table if main.get(listed.id, 0) != listed.node]:
        node = main.get(listed.id, 0)
        own = means[(ids == listed.id) & (nodes == node)]
        table.set(replace(listed, node=node, bounds=compute_middle_bounds(own) if len(own) else listed.bounds))
    return table


def _parse_instance(entry: dict[str, Any]) -> Instance:
    low, high = (tuple(float(value) for value in corner) for corner in entry["bounds"])
    if len(low) != 3 or len(high) != 3 or int(entry["id"]) < 1:
        raise ValueError(f"instance {entry['id']} has an ID below 1 or bounds that are not two corners")
    return Instance(
        id=int(entry["id"]),
        name=require_whole_text(entry["name"]),
        node=int(entry["node"]),
        codeword=int(entry["codeword"]),
        count=int(entry["count"]),
        class_name=require_whole_text(entry["class"]),
        bounds=(low, high),
    )


def _parse_tracks(entries: list[dict[str, Any]], arrays: dict[str, ndarray]) -> tuple[Track, ...]:
    if not entries:
        return ()
    steps = [int(entry["steps"]) for entry in entries]
    if min(steps) < 1:
        raise ValueError("an actor has no poses")
    times = _check_shape(arrays["track_times"].astype(np.float64), (sum(steps),), "track_times")
    poses = _check_shape(arrays["track_poses"].astype(np.float64), (sum(steps), 4, 4), "track_poses")
    ends = np.cumsum(steps)
    return tuple(
        Track(
            id=require_whole_text(entry["id"]),
            label=require_whole_text(entry["label"]),
            dimensions=_check_shape(np.array(entry["dimensions"], np.float64), (3,), "dimensions"),
            times=times[end - count : end],
            world_from_box=poses[end - count : end],
            moving=bool(entry["moving"]),
        )
        for entry, count, end in zip(entries, steps, ends, strict=True)
    )


def _parse_views(entries: list[dict[str, Any]], arrays: dict[str, ndarray]) -> tuple[CameraView, ...]:
    if not entries:
        return ()
    poses = _check_shape(arrays["view_poses"].astype(np.float64), (len(entries), 4, 4), "view_poses")
    views = []
    for entry, pose in zip(entries, poses, strict=True):
        fx, fy, cx, cy = (float(value) for value in entry["intrinsics"])
        width, height = int(entry["width"]), int(entry["height"])
        numbers = (fx, fy, cx, cy, float(entry["time"]))
        if min(width, height) < 1 or not (fx > 0 and fy > 0 and all(map(math.isfinite, numbers))):
            raise ValueError(
                f"view {entry['name']}/{entry['index']} has size {width}×{height}, fx, fy, cx, cy, time {numbers}"
            )
        views.append(
            CameraView(
                camera=Camera(fx, fy, cx, cy, width, height, pose, _parse_lag(entry)),
                name=require_whole_text(entry["name"]),
                index=int(entry["index"]),
                time=float(entry["time"]),
                photo=str(entry["photo"]),
                held_out=bool(entry["held_out"]),
            )
        )
    return tuple(views)


def _parse_lag(entry: dict[str, Any]) -> PhotoLag | None:
    if "lag" not in entry:
        return None
    written = entry["lag"]
    center, start, left = (np.array(written[name], np.float64) for name in ("center", "start", "left"))
    turn, began, taken = (float(written[name]) for name in ("turn", "began", "taken"))
    is_whole = center.shape == start.shape == left.shape == (3,)
    if not is_whole or not np.isfinite([*center, *start, *left, turn, began, taken]).all() or turn == 0:
        raise ValueError(f"view {entry['name']}/{entry['index']} has the lag {written}")
    return PhotoLag(to_vector(center), to_vector(start), to_vector(left), turn, began, taken)


def _parse_mover(entry: dict[str, Any]) -> SeenMover:
    """Parse what was seen moving. Raises ValueError where it was seen nowhere, or outside of a photo."""
    sightings = tuple(
        Sighting(int(seen["step"]), _parse_box([float(value) for value in seen["box"]])) for seen in entry["sightings"]
    )
    if not sightings:
        raise ValueError("something in 'seen_moving' has no sightings")
    return SeenMover(require_whole_text(entry["camera"]), sightings, require_whole_text(entry["label"]))


def _parse_box(corners: list[float]) -> tuple[float, float, float, float]:
    left, top, right, bottom = corners
    if not (0 <= left < right <= 1 and 0 <= top < bottom <= 1):
        raise ValueError(f"'seen_moving' has the box {corners}, which is not a part of a photo")
    return left, top, right, bottom


def _parse_exposures(keys: Any, arrays: dict[str, ndarray]) -> Exposures | None:
    """Parse the exposures; None also where the manifest is older than these."""
    if keys is None:
        return None
    if not (isinstance(keys, list) and all(isinstance(key, str) for key in keys)):
        raise ValueError("'exposures' is not a list of photo keys")
    times = _check_shape(arrays["exposure_times"].astype(np.float64), (len(keys),), "exposure_times")
    matrices = _check_shape(_get_floats(arrays, "exposure_matrices"), (len(keys), 3, 4), "exposure_matrices")
    return Exposures(tuple(keys), times, matrices)


def _parse_extra_columns(arrays: dict[str, ndarray]) -> dict[str, ndarray]:
    """Parse the columns that are not known. Raises ValueError where one could not stand in a .ply."""
    extra = {name.removeprefix(EXTRA): array for name, array in arrays.items() if name.startswith(EXTRA)}
    for name, column in extra.items():
        if column.dtype == np.float16:  # of a scene saved in half precision
            extra[name] = column.astype(np.float32)
        check_extra_column(name, extra[name])
    return extra


def _is_antialiased(value: object) -> bool:
    if not isinstance(value, bool):
        raise TypeError(f"'antialiased' is {value!r}, neither true nor false")
    return value


def _parse_sky(faces: ndarray) -> Sky:
    if faces.ndim != 4 or faces.shape != (6, faces.shape[1], faces.shape[1], 3):
        raise ValueError(f"sky has shape {faces.shape}, expected (6, r, r, 3)")
    if not np.isfinite(faces).all():
        raise ValueError("sky holds numbers that are not finite")
    scale = 255 if faces.dtype == np.uint8 else 1
    return Sky(faces.astype(np.float32) / np.float32(scale))


def _get_floats(arrays: dict[str, ndarray], name: str) -> ndarray:
    array = arrays[name]
    if array.dtype not in (np.float16, np.float32):
        raise ValueError(f"array {name} holds {array.dtype}, expected float16 or float32")
    return array.astype(np.float32, copy=False)


def _get_integers(arrays: dict[str, ndarray], name: str, dtype: type) -> ndarray:
    if arrays[name].dtype != dtype:
        raise ValueError(f"array {name} holds {arrays[name].dtype}, expected {np.dtype(dtype)}")
    return arrays[name]


def _check_shape(array: ndarray, shape: tuple[int, ...], name: str) -> ndarray:
    if array.shape != shape:
        raise ValueError(f"{name} has shape {array.shape}, expected {shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} holds numbers that are not finite")
    return array
