"""The keys of an instance's way: as they were set, or the few that describe its track."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np

from instdrive_core.edits.bases.driven_track import build_path_keys
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.kinds.compound import CompoundEdit
from instdrive_core.edits.kinds.driving.set_path import SetPath
from instdrive_core.edits.kinds.driving.start_driving import StartDriving
from instdrive_core.edits.queries.placement import compute_center
from instdrive_core.scene.track import Track
from instdrive_core.scene.vehicle_path import PathKey, sample_path
from instdrive_core.scene.ways.way_keys import thin_track

_SAME = 0.02
"""Metres that a track may be away from the keys that it was made of: anything else has moved it since."""


def find_way_keys(document: Document, instance_id: int, time: float) -> tuple[PathKey, ...]:
    """Find the keys of an instance's way; of what stands still, one where it is, at `time` (seconds).

    The keys that the user gave it where they still hold; else as few as describe its track. Raises EditError for an
    unknown ID.
    """
    document.find_rows((instance_id,))
    entry = document.scene.table[instance_id]
    if not entry.node:
        x, y, _ = compute_center(document, (instance_id,), time).tolist()
        return (PathKey(time, x, y),)
    track = document.scene.actors[entry.node - 1]
    sharing = {other.id for other in document.scene.table if other.node == entry.node}
    given = next((edit for edit in _list_ways(document) if _is_of(edit, track, sharing)), None)
    if given is not None:
        keys = build_path_keys(given.keys)
        places = sample_path(keys, track.times).places
        if float(np.abs(places - track.world_from_box[:, :2, 3]).max()) <= _SAME:
            return keys
    return thin_track(track)


def _is_of(edit: SetPath | StartDriving, track: Track, ids: Collection[int]) -> bool:
    """Whether an edit has given a track its way."""
    if isinstance(edit, SetPath):
        return edit.id in ids
    name = f"instance {edit.id}"  # and a number where another track has that ID
    return track.id == name or track.id.startswith(f"{name} ")


def _list_ways(document: Document) -> Iterator[SetPath | StartDriving]:
    """The edits that gave ways and are done, the last one first, also as parts of others."""
    waiting: list[Edit] = list(document.history.done)
    while waiting:
        edit = waiting.pop()
        if isinstance(edit, CompoundEdit):
            waiting += edit.edits
        elif isinstance(edit, (SetPath, StartDriving)):
            yield edit
