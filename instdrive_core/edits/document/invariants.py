"""Invariants of a document between two edits; for tests, which try to break them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from instdrive_core.edits.document.document import Document
from instdrive_core.scene.selection import Flag


def find_broken_invariants(document: Document) -> list[str]:
    """A sentence for each invariant that does not hold; empty for a sound document."""
    return [
        *_check_lengths(document),
        *_check_names(document),
        *_check_palettes(document),
        *_check_states(document),
        *_check_history(document),
    ]


def _check_lengths(document: Document) -> Iterator[str]:
    scene, count = document.scene, len(document.scene)
    parts = {**scene.gaussians.arrays(), **scene.extra}
    parts |= {"instance_ids": scene.instance_ids, "codewords": scene.codewords, "nodes": scene.nodes}
    parts |= {"flags": document.state.flags, "color entries": document.colors.indices}
    parts |= {"transform entries": document.transforms.indices}
    for name, array in parts.items():
        if len(array) != count:
            yield f"{name} has {len(array)} rows, the scene {count}"


def _check_names(document: Document) -> Iterator[str]:
    scene = document.scene
    used, counts = np.unique(scene.instance_ids[scene.instance_ids > 0], return_counts=True)
    known = {entry.id for entry in scene.table}
    if nameless := set(used.tolist()) - known:
        yield f"splats have instances {sorted(nameless)[:5]}, which are not in the table"
    if known and max(known) >= document.first_free_id:
        yield f"instance {max(known)} exists, but {document.first_free_id} counts as the first free ID"
    for number, count in zip(used.tolist(), counts.tolist(), strict=True):
        if number in known and scene.table[number].count != count:
            yield f"the table gives instance {number} {scene.table[number].count} splats, it has {count}"
    if len(scene) and int(scene.nodes.max()) > len(scene.actors):
        yield f"node {int(scene.nodes.max())} has no track"


def _check_palettes(document: Document) -> Iterator[str]:
    for name, palette in (("colour", document.colors), ("transform", document.transforms)):
        if len(palette.indices) and int(palette.indices.max()) >= len(palette):
            yield f"a splat names {name} entry {int(palette.indices.max())} of {len(palette)}"
        if not np.isfinite(palette.values).all():
            yield f"the {name} palette holds values that are not finite"


def _check_states(document: Document) -> Iterator[str]:
    flags = document.state.flags
    if np.any((flags & Flag.SELECTED != 0) & (flags & (Flag.DELETED | Flag.HIDDEN) != 0)):
        yield "splats that are not drawn are selected"
    counts = document.count_states()
    deleted = int((document.scene.instance_ids[flags & Flag.DELETED != 0] > 0).sum())
    if int(counts.deleted.sum()) != deleted:
        yield f"{int(counts.deleted.sum())} splats of instances count as deleted, {deleted} are"


def _check_history(document: Document) -> Iterator[str]:
    history = document.history
    if not 0 <= history.cursor <= len(history.edits):
        yield f"{history.cursor} of {len(history.edits)} edits are done"
