"""Which shadows are to be laid, or taken away, after things were put somewhere else."""

from __future__ import annotations

from collections.abc import Iterable
from copy import copy
from dataclasses import dataclass

import numpy as np

from instdrive_core.edits.bases.append import AppendEdit
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.holes.shade import SceneLight
from instdrive_core.edits.kinds.compound import CompoundEdit
from instdrive_core.edits.kinds.delete import DeleteRows
from instdrive_core.edits.kinds.driving.set_path import SetPath
from instdrive_core.edits.kinds.fill_hole import FillHole
from instdrive_core.edits.kinds.light.lay_shadow import (
    LayShadow,
    find_shadow_rows,
    has_learned_shadow,
    make_lay_shadow,
)
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.reset_moves import ResetMoves
from instdrive_core.edits.kinds.shape.complete import CompleteInstance
from instdrive_core.edits.queries.compact_objects import is_compact
from instdrive_core.errors import EditError

LEAST_MOVE = 0.5
"""Metres along the ground: what was moved less still stands in the shadow that the photos show."""
MOST_THINGS = 40
"""Things put at once that get a shadow each; more are no single objects."""


@dataclass(frozen=True)
class Put:
    """What an edit has put somewhere."""

    ids: tuple[int, ...]
    added: frozenset[int]
    """Those of them that were not there before."""


def find_put(edit: Edit) -> Put:
    """Find what a done edit has moved, copied, inserted, completed, or given another way; nothing for other edits, for
    fills, and for those that lay a shadow themselves."""
    if isinstance(edit, CompoundEdit):
        parts = [find_put(part) for part in edit.edits]
        if any(isinstance(part, LayShadow) for part in edit.edits):
            return Put((), frozenset())
        ids = tuple(dict.fromkeys(number for part in parts for number in part.ids))
        return Put(ids, frozenset().union(*(part.added for part in parts)))
    if isinstance(edit, (SetPath, CompleteInstance)):
        return Put((edit.id,), frozenset())
    if isinstance(edit, (MoveInstances, ResetMoves)):
        return Put(tuple(edit.ids), frozenset())
    if isinstance(edit, AppendEdit) and not isinstance(edit, FillHole):
        return Put(edit.added_ids, frozenset(edit.added_ids))
    return Put((), frozenset())


def plan_shadows(document: Document, put: Put, light: SceneLight, time: float) -> tuple[Edit, ...]:
    """Plan the edits that lay a shadow below each thing that was put somewhere, and take away those that are wrong now.

    Things back in their places have the shadow of the photos, and what moves may take its own along; surfaces, what
    floats, and whole scenes that were inserted with their own ground get none. The edits are tried on `document`: give
    a frozen copy.
    """
    known = [number for number in put.ids if number in document.scene.table]
    table = document.scene.table
    if len(known) > MOST_THINGS or any(_is_surface(document, number) for number in put.added & {*known}):
        return ()
    steps: list[Edit] = []
    for number in known:
        wanted: Edit | None = None
        casts = is_compact(table[number]) and not has_learned_shadow(document, number)
        if casts and (number in put.added or measure_move(document, number) >= LEAST_MOVE):
            wanted = make_lay_shadow(number, light, time)
        if wanted is None or not _try(wanted, document):
            old = find_shadow_rows(document, number)
            wanted = DeleteRows(old) if len(old) else None
            if wanted is None or not _try(wanted, document):
                continue
        steps.append(wanted)
    return tuple(steps)


def measure_move(document: Document, number: int) -> float:
    """Measure how far along the ground an instance is from where it was trained, metres; of what drives, the farthest
    it ever is."""
    entry = document.scene.table[number]
    if entry.node:
        now, then = document.scene.actors[entry.node - 1], document.get_first_track(entry.node)
        times = np.unique(np.concatenate([now.times, then.times]))
        apart = now.interpolate_poses(times)[:, :2, 3] - then.interpolate_poses(times)[:, :2, 3]
        return float(np.hypot(apart[:, 0], apart[:, 1]).max())
    rows = document.find_rows((number,))
    move = document.transforms.get_move(int(np.bincount(document.transforms.indices[rows]).argmax()))
    here = np.array(entry.bounds).mean(axis=0)
    there = np.linalg.solve(move[:, :3], here - move[:, 3])
    return float(np.linalg.norm((here - there)[:2]))


def _is_surface(document: Document, number: int) -> bool:
    low, high = np.array(document.scene.table[number].bounds)
    return float((high - low)[:2].max()) > 2 * float((high - low)[2]) and not is_compact(document.scene.table[number])


def _try(edit: Edit, document: Document) -> bool:
    try:
        return copy(edit).do(document)
    except EditError:
        return False


def list_put(edits: Iterable[Edit]) -> Put:
    """Join what several edits have put somewhere."""
    return find_put(CompoundEdit(tuple(edits), "edits"))
