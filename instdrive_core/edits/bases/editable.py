"""Splats of instances that may be edited: neither deleted nor locked."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy import ndarray

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import describe_ids
from instdrive_core.edits.document.row_kernels import keep_free_rows
from instdrive_core.edits.document.row_parts import RowParts
from instdrive_core.edits.document.synthetic_rows import find_shadow
from instdrive_core.errors import EditError
from instdrive_core.scene.selection import Flag
from instdrive_core.wording import phrase


def find_editable_rows(document: Document, ids: tuple[int, ...]) -> ndarray:
    """Rows of the instances that are neither deleted nor locked. Raises EditError where none is left."""
    rows = document.find_rows(ids)
    flags = document.state.flags[rows]
    free = rows[(flags & (Flag.DELETED | Flag.LOCKED)) == 0]
    if not len(free):
        raise _not_editable_error(ids, bool(((flags & Flag.LOCKED) != 0).any()))
    return free


def find_editable_parts(document: Document, ids: tuple[int, ...]) -> RowParts:
    """Rows of each instance that are neither deleted nor locked. Raises EditError where an instance has none."""
    parts, flags = document.find_row_parts(ids), document.state.flags
    free = RowParts(*keep_free_rows(parts.rows, parts.bounds, flags, np.uint8(Flag.DELETED | Flag.LOCKED)))
    none_left = np.flatnonzero(free.sizes == 0)
    if len(none_left):
        first = int(none_left[0])
        rows = parts.rows[parts.bounds[first] : parts.bounds[first + 1]]
        raise _not_editable_error(ids[first : first + 1], bool(((flags[rows] & Flag.LOCKED) != 0).any()))
    return free


def find_colorable_parts(document: Document, ids: tuple[int, ...]) -> RowParts:
    """Find the rows of `find_editable_parts` without shadows that were laid, which stay black.

    Those of an instance that is nothing else count.
    """
    parts = find_editable_parts(document, ids)
    bodies = parts.filter(~find_shadow(document, parts.rows))
    return bodies if bodies.sizes.all() else parts


def _not_editable_error(ids: tuple[int, ...], locked: bool) -> EditError:
    objects = describe_ids(ids)
    if locked:
        return EditError(phrase("{objects}: every splat is locked; unlock it first", objects=objects))
    return EditError(phrase("{objects}: every splat is deleted already", objects=objects))


def check_unlocked(document: Document, ids: Iterable[int]) -> None:
    """Raise EditError where any of these instances is locked: its name, class and splats must not change."""
    wanted = tuple(ids)
    parts = document.find_row_parts(wanted)
    states = document.state.flags[parts.rows] & np.uint8(Flag.DELETED | Flag.LOCKED)
    locked = np.flatnonzero(states == Flag.LOCKED)
    if len(locked):
        instance_id = wanted[int(np.searchsorted(parts.bounds, locked[0], side="right")) - 1]
        raise EditError(phrase("instance {instance_id} is locked; unlock it first", instance_id=instance_id))
