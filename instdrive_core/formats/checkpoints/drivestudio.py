"""drivestudio's ``checkpoint_final.pth``: background, rigid, deformable and human nodes, and a sky.

Layout (Chen et al. 2025, "OmniRe"; ``models/trainers``, ``models/nodes``): ``{"models": {class: state}, "step"}``. A
class of Gaussians has ``_means``, ``_quats``, ``_scales``, ``_opacities``, ``_features_dc``, ``_features_rest``; nodes
have the instance of each row in ``points_ids`` (n, 1), and per frame and instance ``instances_quats``,
``instances_trans``, ``instances_fv`` (whether it is there) and per instance ``instances_size``. No times are written:
frames are 0.1 s apart, as the preprocessing makes them.

Nodes become actors with tracks. What bends besides has one shape, that of the frame nearest to the time asked for.
Colours above the constant SH are kept in the world's axes there; they are turned to be right in that frame.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

import numpy as np
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.torch_checkpoint import TorchCheckpoint
from instdrive_core.formats.actors.boxes import BOX_FROM_FORWARD_X, build_poses, turn_into_box
from instdrive_core.formats.allocation import ReadOptions
from instdrive_core.formats.checkpoints.bending import NodeClass, bend_body, bend_deformable
from instdrive_core.formats.checkpoints.cube_texture import read_cube_sky
from instdrive_core.formats.checkpoints.splat_part import REMEDY, FieldNames, read_parts, require_tensor, view_part
from instdrive_core.instances.table import build_instance_table
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.track import Track

STEP_SECONDS = 0.1
_FIELDS = FieldNames("_means", "_quats", "_scales", "_opacities", "_features_dc", "_features_rest", True)
_BACKGROUND = "Background"
_NODE_LABELS = {"RigidNodes": "vehicle", "DeformableNodes": "deformable", "SMPLNodes": "person"}
_TEXTURE_FROM_WORLD = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
_MOST_ACTORS = 65_000
_LEFT_OUT = {
    "Affine": "the network of exposures (Affine): the splats' own colours are drawn",
    "CamPose": "corrections of the cameras (CamPose), as the checkpoint does not hold the cameras",
    "CamPosePerturb": "disturbances of the cameras (CamPosePerturb), as the checkpoint does not hold the cameras",
}


@dataclass(frozen=True)
class _Placed:
    """Gaussians of a class in the boxes of their actors."""

    tracks: tuple[Track, ...]
    owners: ndarray
    """Which of the tracks each kept row belongs to (m,)."""


def find_models(file: TorchCheckpoint) -> Mapping[Any, Any] | None:
    """The states of drivestudio's models by class; None where it is another checkpoint."""
    models = file.find_items((file.find_items(file.content) or {}).get("models"))
    if models is None or not any("_means" in (file.find_items(state) or {}) for state in models.values()):
        return None
    return models


def read_drivestudio_checkpoint(file: TorchCheckpoint, models: Mapping[Any, Any], options: ReadOptions) -> Scene:
    """Read the background, the actors with their tracks, and the sky. Raises DataError."""
    states = {name: file.find_items(state) or {} for name, state in models.items() if isinstance(name, str)}
    known = [_BACKGROUND, *_NODE_LABELS]
    names = [name for name in known if "_means" in states.get(name, {})]
    left_out = [_LEFT_OUT[name] for name in states if name in _LEFT_OUT]
    others = [name for name in states if name not in (*known, *_LEFT_OUT, "Sky")]
    left_out += [f"{name[:80]!r}, a kind of node that is not known here" for name in others]
    parts = [view_part(file, states[name], _FIELDS, name) for name in names]
    gaussians, places = read_parts(file.path, parts, options)
    step = (file.find_items(file.content) or {}).get("step")
    tracks: list[Track] = []
    nodes = np.zeros(len(gaussians), np.uint16)
    starts = accumulate(map(len, parts), initial=0)
    for name, part, rows, start in zip(names, parts, places, starts, strict=False):
        if name == _BACKGROUND:
            continue
        kept = np.arange(rows.stop - rows.start) * options.keep_every + -start % options.keep_every
        node = _read_node_class(file, states[name], name, len(part), kept, step if type(step) is int else None)
        placed = _place_class(node, gaussians.select(rows), options.time, left_out)
        nodes[rows] = len(tracks) + 1 + placed.owners
        tracks += placed.tracks
    if len(tracks) > _MOST_ACTORS:
        raise DataError(file.path, f"it has {len(tracks)} actors, more than {_MOST_ACTORS}", REMEDY)
    ids = nodes.astype(np.uint32)
    labels = {row + 1: track.label for row, track in enumerate(tracks)}
    titles = {row + 1: track.id for row, track in enumerate(tracks)}
    return Scene(
        gaussians=gaussians,
        instance_ids=ids,
        codewords=np.zeros(len(gaussians), np.uint32),
        nodes=nodes,
        table=build_instance_table(ids, gaussians.means, None, nodes, titles, labels),
        actors=tuple(tracks),
        sky=read_cube_sky(file, states["Sky"].get("base"), _TEXTURE_FROM_WORLD, left_out) if "Sky" in states else None,
        left_out=tuple(left_out),
    )


def _read_node_class(
    file: TorchCheckpoint, state: Mapping[Any, Any], name: str, count: int, kept: ndarray, step: int | None
) -> NodeClass:
    def read(field: str, *shape: int | None) -> ndarray:
        tensor = require_tensor(file, state, field, name)
        fits = len(tensor.shape) == len(shape) and all(
            wanted is None or found == wanted for found, wanted in zip(tensor.shape, shape, strict=True)
        )
        values = tensor.read() if fits else np.empty(0)
        if not fits or not np.isfinite(values).all():
            wanted = " x ".join("n" if size is None else str(size) for size in shape)
            problem = f"'{name}.{field}' has shape {tensor.shape}, not {wanted}, or holds what is no number"
            raise DataError(file.path, problem, REMEDY)
        return values

    present = read("instances_fv", None, None).astype(bool)
    frames, instances = present.shape
    quats = require_tensor(file, state, "instances_quats", name)
    middle = (1,) if len(quats.shape) == 4 else ()
    rotations = read("instances_quats", frames, instances, *middle, 4).reshape(frames, instances, 4)
    owners = read("points_ids", count, 1)[kept, 0]
    if len(owners) and not (owners.min() >= 0 and owners.max() < instances):
        raise DataError(file.path, f"'{name}.points_ids' names an instance that is not there", REMEDY)
    translations = read("instances_trans", frames, instances, 3)
    sizes = read("instances_size", instances, 3)
    return NodeClass(file, name, state, owners.astype(np.int64), present, rotations, translations, sizes, step)


def _place_class(node: NodeClass, gaussians: Gaussians, time: float | None, left_out: list[str]) -> _Placed:
    """Give each instance its shape and its box, in place."""
    forward_is_x = np.median(node.sizes[:, 0]) >= np.median(node.sizes[:, 1]) if len(node.sizes) else True
    turn = BOX_FROM_FORWARD_X if forward_is_x else np.eye(3)
    tracks, owners = [], np.zeros(len(node.owners), np.int64)
    reasons: dict[str, int] = {}
    order = np.argsort(node.owners, kind="stable")
    instances, starts = np.unique(node.owners[order], return_index=True)
    for instance, rows in zip(instances.tolist(), np.split(order, starts[1:]), strict=True):
        frames = np.flatnonzero(node.present[:, instance])
        owners[rows] = len(tracks)
        if not len(frames):
            frames = np.arange(1)
            left_out.append(f"when {node.name} {instance} is there, as it is in no frame: it stands at its first pose")
        frame = _find_frame(frames, time)
        part = gaussians.select(rows)
        poses = build_poses(node.rotations[frames, instance], node.translations[frames, instance])
        here = poses[int(np.searchsorted(frames, frame))]
        center = np.zeros(3)
        try:
            if node.name == "DeformableNodes":
                bend_deformable(node, part, instance, frame)
            elif node.name == "SMPLNodes":
                center = bend_body(node, part, instance, frame, poses)
        except ValueError as error:
            reasons[str(error)] = reasons.get(str(error), 0) + 1
        turn_into_box(part, here, turn, center)
        for name, array in part.arrays().items():
            getattr(gaussians, name)[rows] = array
        poses[:, :3, 3] += np.einsum("tab,b->ta", poses[:, :3, :3], center)
        poses[:, :3, :3] = poses[:, :3, :3] @ turn.T
        tracks.append(
            Track(
                id=f"{node.name} {instance}",
                label=_NODE_LABELS[node.name],
                dimensions=np.abs(turn) @ node.sizes[instance].astype(np.float64),
                times=frames * STEP_SECONDS,
                world_from_box=poses,
                moving=True,
            )
        )
    left_out += [f"how {count} of the {node.name} bend, as {reason}" for reason, count in reasons.items()]
    if tracks and node.name != "RigidNodes":
        moment = "in the middle of each one's track" if time is None else f"nearest to {time:g} s"
        left_out.append(f"the motion of limbs of {len(tracks)} {node.name}: all have the shape of the frame {moment}")
    return _Placed(tuple(tracks), owners)


def _find_frame(frames: ndarray, time: float | None) -> int:
    if time is None:
        return int(frames[len(frames) // 2])
    return int(frames[np.abs(frames * STEP_SECONDS - time).argmin()])
