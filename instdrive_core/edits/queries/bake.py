"""Baking an edited document into a scene that needs no document: what is exported."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Int
from numpy import ndarray

from instdrive_core.edits.document.document import Document
from instdrive_core.instances.shadows import find_marked_shadows
from instdrive_core.instances.table import build_instance_table
from instdrive_core.maths.sh_rotation import rotate_rest
from instdrive_core.progress import report
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.palette import bake_colors
from instdrive_core.scene.scene import Scene, extract_node_rotations, place_in_world
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.transforms import bake_transforms


def bake_document(
    document: Document, time: float | None = None, rows: Int[ndarray, " k"] | None = None, *, to_read: bool = False
) -> Scene:
    """The edited scene: deleted rows gone, colours in the SH coefficients, moves done, instances counted again.

    With a `time` (seconds) the actors are placed where they are then, or left out where they are not yet or no longer,
    and become part of the background; without one they keep their frames and tracks.
    With `rows`, rising, only those of them that are left; tracks, sky and cameras stay (`bake_part` takes them away).
    Arrays are copies; rows that no edit touched and no track moves keep their bits. `to_read` promises that nothing is
    written to them: where every row is left, arrays that no edit has changed are then the document's own.
    """
    scene = document.scene
    deleted = document.state.find_mask(Flag.DELETED)
    keep = np.flatnonzero(~deleted) if rows is None else rows[~deleted[rows]]
    recolored = np.flatnonzero(document.colors.indices[keep])
    if to_read and len(keep) == len(scene):
        moved = bool(document.transforms.indices.any())
        gaussians = _copy_written_arrays(scene.gaussians, len(recolored) > 0, moved)
    else:
        gaussians = scene.gaussians.select(keep)
    report(0.3)
    if len(recolored):
        dc, rest, logits = bake_colors(scene.gaussians, document.colors, keep[recolored])
        gaussians.sh_dc[recolored], gaussians.sh_rest[recolored] = dc, rest
        gaussians.opacity_logits[recolored] = logits
    bake_transforms(gaussians, document.transforms, document.transforms.indices[keep])
    report(0.6)
    edited = recount_table(_select_rows(scene, keep, gaussians))
    return edited if time is None else freeze_at_time(edited, time)


def freeze_at_time(scene: Scene, time: float) -> Scene:
    """The scene at one moment, without tracks: actors present at `time` (seconds) become background."""
    if not scene.actors:
        return scene
    poses, present = scene.find_node_poses(time)
    keep = np.flatnonzero(present[scene.nodes])
    gaussians, nodes = scene.gaussians.select(keep), scene.nodes[keep]
    gaussians.means, gaussians.quats = place_in_world(gaussians.means, gaussians.quats, nodes, poses)
    rotations = extract_node_rotations(poses)
    for node in np.unique(nodes[nodes > 0]).tolist():
        rows = np.flatnonzero(nodes == node)
        gaussians.sh_rest[rows] = rotate_rest(gaussians.sh_rest[rows], rotations[node])
    static = _select_rows(scene, keep, gaussians)
    return recount_table(replace(static, nodes=np.zeros_like(nodes), actors=()))


def recount_table(scene: Scene) -> Scene:
    """A scene whose table has counts and bounds taken from its arrays; names and classes stay."""
    table = build_instance_table(
        scene.instance_ids,
        scene.gaussians.means,
        scene.codewords,
        scene.nodes,
        names={instance.id: instance.name for instance in scene.table},
        classes={instance.id: instance.class_name for instance in scene.table},
        shadows=find_marked_shadows(scene.extra),
    )
    return replace(scene, table=table)


def _copy_written_arrays(gaussians: Gaussians, colors: bool, places: bool) -> Gaussians:
    """Gaussians with copies of the arrays that baking writes: those of colours, of places, or both."""
    written = {"sh_dc", "sh_rest", "opacity_logits"} if colors else set()
    written |= {"means", "quats", "log_scales", "sh_rest"} if places else set()
    arrays = gaussians.arrays()
    return Gaussians(**{name: array.copy() if name in written else array for name, array in arrays.items()})


def _select_rows(scene: Scene, rows: ndarray, gaussians: Gaussians) -> Scene:
    return replace(
        scene,
        gaussians=gaussians,
        instance_ids=scene.instance_ids[rows],
        codewords=scene.codewords[rows],
        nodes=scene.nodes[rows],
        extra={name: column[rows] for name, column in scene.extra.items()},
    )
