"""The edit that gives a document the objects that photos show of its scene."""

from __future__ import annotations

import numpy as np

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.row_runs import RowRuns
from instdrive_core.edits.kinds.find_objects import FindObjects
from instdrive_core.edits.kinds.labels.relabel_rows import RelabelRows
from instdrive_core.errors import EditError
from instdrive_core.finding.seen_objects import SeenObjects
from instdrive_core.scene.selection import Flag
from instdrive_core.wording import phrase

_PROTECTED = np.uint8(Flag.DELETED | Flag.HIDDEN | Flag.LOCKED)
_JOINS = 0.5
"""An object of which more than this share belongs to one instance already is that instance."""


def plan_relabeling(document: Document, found: SeenObjects, replaces: bool) -> RelabelRows:
    """Plan the edit after which each object found in photos is an instance.

    Deleted, hidden and locked splats stay as they are, and so do those that edits added. Splats of instances do,
    too, unless the objects found replace those; what else is found of such an instance then joins it.

    Raises EditError where no splat would change, or the scene is another one.
    """
    count = len(found.numbers)
    if count > len(document.scene):
        raise EditError(phrase("the objects were found in another scene, of {count:,} splats", count=count))
    now, flags = document.scene.instance_ids[:count], document.state.flags[:count]
    free = ((flags & _PROTECTED) == 0) & (found.numbers > 0)
    if not replaces:
        free &= now == 0
    order = np.argsort(found.numbers, kind="stable")
    bounds = np.searchsorted(found.numbers[order], np.arange(1, len(found.classes) + 2))
    parts, into, classes = [], [], []
    for place, class_name in enumerate(found.classes):
        rows = order[bounds[place] : bounds[place + 1]]
        open_rows = rows[free[rows]]
        if not len(open_rows):
            continue
        known = 0 if replaces else _find_known_instance(now[rows])
        parts.append(RowRuns.from_rows(open_rows))
        into.append(known or None)
        classes.append("" if known else class_name)
    if not parts:
        raise EditError(
            "each splat that the photos show belongs to an instance already, or is deleted, hidden or locked; "
            "replace the instances, or show and unlock them first"
        )
    return RelabelRows(FindObjects.kind, tuple(parts), tuple(into), classes=tuple(classes))


def _find_known_instance(ids: np.ndarray) -> int:
    """The instance that more than half of an object's splats belong to; 0 where there is none."""
    found, counts = np.unique(ids, return_counts=True)
    most = int(np.argmax(counts))
    return int(found[most]) if counts[most] > _JOINS * len(ids) else 0
