"""HUGSIM's exported scenes: ``scene.pth``, ``dynamic_ID.pth``, ``unicycle_ID.pth``, ``meta_data.json``, ``cfg.yaml``.

A ``.pth`` of Gaussians is (parameters, iteration); the parameters are a tuple or, of older scenes that were exported
anew, a list: degree, xyz, constant SH, the rest, 3D features, scaling, rotation, opacity, extent. Those of a scene have
the network of exposures and the ground behind, whose eight parameters end with its opacity (Zhou et al. 2024,
``scene/gaussian_model.py``, ``scene/ground_model.py``, ``eval_render/export_scene.py``).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from instdrive_core.errors import DataError
from instdrive_core.files.json_fields import read_json
from instdrive_core.files.torch_checkpoint import TorchCheckpoint, open_torch_checkpoint
from instdrive_core.formats.actors.boxes import turn_into_box
from instdrive_core.formats.actors.moments import find_shown_row
from instdrive_core.formats.actors.row import lay_into_row
from instdrive_core.formats.allocation import ReadOptions
from instdrive_core.formats.checkpoints.hugsim_tracks import (
    WORLD_UP,
    ObjectPath,
    choose_box_turn,
    collect_boxes,
    collect_written_paths,
    read_unicycle,
)
from instdrive_core.formats.checkpoints.splat_part import REMEDY, FieldNames, SplatPart, read_parts, view_part
from instdrive_core.instances.table import build_instance_table
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.track import Track

_NAMES = ("degree", "xyz", "features_dc", "features_rest", "features_3d", "scaling", "rotation", "opacity")
_FIELDS = FieldNames("xyz", "rotation", "scaling", "opacity", "features_dc", "features_rest")
_GROUND = replace(_FIELDS, flat_in_y=True)
_OBJECT_ENTRIES, _SCENE_ENTRIES = 9, 11
HUGSIM_META = "meta_data.json"
_OBJECT = re.compile(r"dynamic_([^_]{1,100}?)\.pth")
_MOST_OBJECTS = 10_000


def find_hugsim(file: TorchCheckpoint) -> Sequence[Any] | None:
    """The parameters of HUGSIM's Gaussians; None where it is another checkpoint."""
    content = file.content
    if isinstance(content, tuple) and len(content) == 2 and isinstance(content[0], tuple | list):
        return content[0] if len(content[0]) in (_OBJECT_ENTRIES, _SCENE_ENTRIES) else None
    return None


def read_hugsim(file: TorchCheckpoint, captured: Sequence[Any], options: ReadOptions) -> Scene:
    """Read a scene with its ground and the moving objects beside it, or one object. Raises DataError."""
    parts = [_view(file, captured, "the scene", _FIELDS)]
    left_out = ["semantic features per splat, which no palette names"]
    if len(captured) != _SCENE_ENTRIES:
        gaussians, _ = read_parts(file.path, parts, options)
        zeros = np.zeros(len(gaussians), np.uint32)
        return Scene(gaussians, zeros, zeros.copy(), zeros.astype(np.uint16), left_out=tuple(left_out))
    left_out.append("the network of exposures: the splats' own colours are drawn")
    ground = captured[-1]
    if isinstance(ground, tuple | list) and len(ground) >= len(_NAMES):
        parts.append(_view(file, ground, "ground", _GROUND))
    elif ground is not None:
        raise DataError(file.path, "the ground holds no Gaussians", REMEDY)
    still = len(parts)
    objects = list_moving_objects(file.path.parent)
    meta_path = file.path.parent / HUGSIM_META
    meta = read_json(meta_path) if objects and meta_path.is_file() else None
    paths, boxes = collect_written_paths(meta_path, meta), collect_boxes(meta_path, meta)
    for name, object_path in objects.items():
        fitted = file.path.parent / f"unicycle_{name}.pth"
        if fitted.is_file():
            paths[name] = read_unicycle(fitted)
        other = open_torch_checkpoint(object_path)
        found = find_hugsim(other)
        if found is None:
            raise DataError(object_path, "it holds no Gaussians of HUGSIM", REMEDY)
        parts.append(_view(other, found, f"object {name}", _FIELDS))
    # The scene's rows are background first, then what moves.
    order = sorted(zip(objects, parts[still:], strict=True), key=lambda entry: entry[0] in paths)
    gaussians, places = read_parts(file.path, [*parts[:still], *(part for _, part in order)], options)
    rows = {name: place for (name, _), place in zip(order, places[still:], strict=True)}
    missing = sum(name not in paths for name in rows)
    if missing:
        left_out.append(
            f"tracks of {missing} moving objects, which lie in a row above the street: neither unicycle_ID.pth nor "
            f"{HUGSIM_META} beside the scene has them; copy the folder whole"
        )
    return _place_objects(gaussians, rows, paths, boxes, options.time, left_out)


def list_moving_objects(folder: Path) -> dict[str, Path]:
    """List the files of moving objects beside a scene by their IDs. Raises DataError where there are too many."""
    found = {match[1]: file for file in sorted(folder.glob("dynamic_*.pth")) if (match := _OBJECT.fullmatch(file.name))}
    if len(found) > _MOST_OBJECTS:
        raise DataError(folder, f"it holds {len(found)} moving objects, more than {_MOST_OBJECTS}", REMEDY)
    return found


def _view(file: TorchCheckpoint, captured: Sequence[Any], where: str, fields: FieldNames) -> SplatPart:
    return view_part(file, dict(zip(_NAMES, captured, strict=False)), fields, where)


def _place_objects(
    gaussians: Gaussians,
    rows: Mapping[str, slice],
    paths: Mapping[str, ObjectPath],
    boxes: Mapping[str, np.ndarray],
    time: float | None,
    left_out: Sequence[str],
) -> Scene:
    """Put each object's Gaussians, in place, into its box or into the row above the street, and name it."""
    ids, nodes = np.zeros(len(gaussians), np.uint32), np.zeros(len(gaussians), np.uint16)
    titles, labels, actors = {}, {}, []
    place = 0.0
    for instance, (name, part) in enumerate(rows.items(), start=1):
        view = gaussians.select(part)
        ids[part], titles[instance], labels[instance] = instance, f"object {name}", "vehicle"
        if name not in paths:
            place = lay_into_row(view, place, WORLD_UP)
            continue
        corners = boxes[name] if name in boxes else _measure_box(view)
        track = _build_track(f"object {name}", paths[name], corners)
        actors.append(track)
        nodes[part] = len(actors)
        turn = choose_box_turn(paths[name], corners[1] - corners[0])
        pose = paths[name].world_from_object[find_shown_row(track, time)]
        turn_into_box(view, pose, turn, corners.mean(axis=0))
    return Scene(
        gaussians=gaussians,
        instance_ids=ids,
        codewords=np.zeros(len(gaussians), np.uint32),
        nodes=nodes,
        table=build_instance_table(ids, gaussians.means, None, nodes, titles, labels),
        actors=tuple(actors),
        left_out=tuple(left_out),
    )


def _build_track(name: str, motion: ObjectPath, corners: np.ndarray) -> Track:
    size, center = corners[1] - corners[0], corners.mean(axis=0)
    turn = choose_box_turn(motion, size)
    poses = motion.world_from_object.copy()
    poses[:, :3, 3] += poses[:, :3, :3] @ center
    poses[:, :3, :3] = poses[:, :3, :3] @ turn.T
    return Track(name, "vehicle", np.abs(turn) @ size, motion.times, poses, moving=True)


def _measure_box(part: Gaussians) -> np.ndarray:
    """Lower and upper corner of the box that holds nearly all of an object."""
    finite = part.means[np.isfinite(part.means).all(axis=1)].astype(np.float64)
    return np.percentile(finite, [1, 99], axis=0) if len(finite) else np.array([[-0.5] * 3, [0.5] * 3])
