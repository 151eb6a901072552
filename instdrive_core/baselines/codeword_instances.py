"""A scene's instances without what this project adds to any method: one ID per code over the whole scene."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

from instdrive_core.instances.table import build_instance_table
from instdrive_core.scene.scene import Scene
from instdrive_core.training.instances.naming import make_display_names


def assign_instances_by_codeword(scene: Scene) -> Scene:
    """Copy a scene with one instance per codeword, over all actors and the background, however far apart.

    IDs count from 1 in the order of the codewords. A code's class is that of most of its classified Gaussians.
    """
    _, places = np.unique(scene.codewords, return_inverse=True)
    ids = (places + 1).astype(np.uint32)
    votes: dict[int, Counter[str]] = {}
    pairs, counts = np.unique(np.stack([ids, scene.instance_ids]), axis=1, return_counts=True)
    for new, old, count in zip(*pairs.tolist(), counts.tolist(), strict=True):
        if old in scene.table and scene.table[old].class_name:
            votes.setdefault(new, Counter())[scene.table[old].class_name] += count
    classes = {new: counter.most_common(1)[0][0] for new, counter in votes.items()}
    table = build_instance_table(
        ids, scene.gaussians.means, scene.codewords, scene.nodes, make_display_names(ids, classes), classes
    )
    return replace(scene, instance_ids=ids, table=table)
