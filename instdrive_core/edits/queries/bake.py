"""From an edited document to a scene that needs no document: what is exported."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Int
from numpy import ndarray

from instdrive_core.edits.document.document import Document
from instdrive_core.instances.table import table_from_ids
from instdrive_core.maths.sh_rotation import rotated_rest
from instdrive_core.progress import report
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.palette import baked_colors
from instdrive_core.scene.scene import Scene, node_rotations, placed
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.transforms import transform_rows


def baked(
    document: Document, time: float | None = None, rows: Int[ndarray, " k"] | None = None, *, to_read: bool = False
) -> Scene:
    """The edited scene: deleted rows gone, colours in the SH coefficients, moves done, instances counted again.

    With a `time` (seconds) the actors are placed where they are then, or left out where they are not yet or no longer,
    and become part of the background; without one they keep their frames and tracks.
    With `rows`, rising, only those of them that are left; tracks, sky and cameras stay (`edits.parts` takes them away).
    Arrays are copies; rows that no edit touched and no track moves keep their bits. `to_read` promises that nothing is
    written to them: where every row is left, arrays that no edit has changed are then the document's own.
    """
    scene = document.scene
    deleted = document.state.mask(Flag.DELETED)
    keep = np.flatnonzero(~deleted) if rows is None else rows[~deleted[rows]]
    recolored = np.flatnonzero(document.colors.indices[keep])
    if to_read and len(keep) == len(scene):
        moved = bool(document.transforms.indices.any())
        gaussians = _with_copies_of(scene.gaussians, len(recolored) > 0, moved)
    else:
        gaussians = scene.gaussians.select(keep)
    report(0.3)
    if len(recolored):
        dc, rest, logits = baked_colors(scene.gaussians, document.colors, keep[recolored])
        gaussians.sh_dc[recolored], gaussians.sh_rest[recolored] = dc, rest
        gaussians.opacity_logits[recolored] = logits
    transform_rows(gaussians, document.transforms, document.transforms.indices[keep])
    report(0.6)
    edited = recounted(_rows_of_scene(scene, keep, gaussians))
    return edited if time is None else frozen_at(edited, time)


def frozen_at(scene: Scene, time: float) -> Scene:
    """The scene at one moment, without tracks: actors present at `time` (seconds) become background."""
    if not scene.actors:
        return scene
    poses, present = scene.at(time)
    keep = np.flatnonzero(present[scene.nodes])
    gaussians, nodes = scene.gaussians.select(keep), scene.nodes[keep]
    gaussians.means, gaussians.quats = placed(gaussians.means, gaussians.quats, nodes, poses)
    rotations = node_rotations(poses)
    for node in np.unique(nodes[nodes > 0]).tolist():
        rows = np.flatnonzero(nodes == node)
        gaussians.sh_rest[rows] = rotated_rest(gaussians.sh_rest[rows], rotations[node])
    static = _rows_of_scene(scene, keep, gaussians)
    return recounted(replace(static, nodes=np.zeros_like(nodes), actors=()))


def recounted(scene: Scene) -> Scene:
    """The same scene with counts and bounds of its instances taken from the arrays; names and classes stay."""
    table = table_from_ids(
        scene.instance_ids,
        scene.gaussians.means,
        scene.codewords,
        scene.nodes,
        names={instance.id: instance.name for instance in scene.table},
        classes={instance.id: instance.class_name for instance in scene.table},
    )
    return replace(scene, table=table)


def _with_copies_of(gaussians: Gaussians, colors: bool, places: bool) -> Gaussians:
    """The same Gaussians, of which baking may write the colours, or the places, or both."""
    written = {"sh_dc", "sh_rest", "opacity_logits"} if colors else set()
    written |= {"means", "quats", "log_scales", "sh_rest"} if places else set()
    arrays = gaussians.arrays()
    return Gaussians(**{name: array.copy() if name in written else array for name, array in arrays.items()})


def _rows_of_scene(scene: Scene, rows: ndarray, gaussians: Gaussians) -> Scene:
    return replace(
        scene,
        gaussians=gaussians,
        instance_ids=scene.instance_ids[rows],
        codewords=scene.codewords[rows],
        nodes=scene.nodes[rows],
        extra={name: column[rows] for name, column in scene.extra.items()},
    )
