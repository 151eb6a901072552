"""The scene that training on has made: rows of the finished one in their places, then what grew from them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Int64
from numpy import ndarray

from instdrive_core.instances.shadows import find_marked_shadows
from instdrive_core.instances.table import InstanceTable, build_instance_table
from instdrive_core.rasterize.sky_evidence import fill_scene_sky
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.exposure import Exposures
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.sky import Sky
from instdrive_core.training.gaussians.lineage import Lineage
from instdrive_core.training.gaussians.model import SceneModel


def order_rows(lineage: Lineage) -> Int64[ndarray, " n"]:
    """Order the model's rows as the scene has them: each row of the finished scene in its place, then what grew."""
    standing, grown = np.flatnonzero(lineage.stands), np.flatnonzero(~lineage.stands)
    return np.concatenate([standing[np.argsort(lineage.ancestors[standing])], grown])


def export_improved_scene(
    base: Scene, model: SceneModel, lineage: Lineage, views: tuple[CameraView, ...], exposures: Exposures | None
) -> Scene:
    """Export what was trained. IDs, codewords and unknown columns of what grew are those of what it grew from.

    Args:
        base: the finished scene that training went on from.
        model: the trained one, on the CPU.
        lineage: of the model's rows.
        views: the clip's, where training found the cameras.
        exposures: of the training photos.
    """
    order = order_rows(lineage)
    parents = lineage.ancestors[order]
    trained = model.gaussians().select(order)
    ids, nodes = base.instance_ids[parents], base.nodes[parents]
    extra = {name: column[parents] for name, column in base.extra.items()}
    counted = build_instance_table(ids, trained.means, None, nodes, shadows=find_marked_shadows(extra))
    scene = Scene(
        gaussians=replace(trained, features=base.gaussians.features[parents]),
        instance_ids=ids,
        codewords=base.codewords[parents],
        nodes=nodes,
        table=_count_again(base.table, counted),
        actors=model.tracks(),
        sky=Sky(model.shared["sky"].detach().cpu().numpy().clip(0, 1)),
        views=views,
        origin=base.origin,
        exposures=exposures,
        code_bits=base.code_bits,
        extra=extra,
        seen_movers=base.seen_movers,
    )
    return replace(scene, sky=fill_scene_sky(scene))


def _count_again(table: InstanceTable, counted: InstanceTable) -> InstanceTable:
    """Names, classes and codewords as they were; nodes, counts and bounds as they are now."""
    result = InstanceTable()
    for entry in table:
        now = counted.instances.get(entry.id)
        result.set(entry if now is None else replace(entry, node=now.node, count=now.count, bounds=now.bounds))
    return result
