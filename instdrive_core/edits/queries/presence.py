"""When things are there: a moving object exists as long as its track does, everything else all the time."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from instdrive_core.edits.document.document import Document
from instdrive_core.scene.track import Track


def list_passing(document: Document, ids: Collection[int], times: Sequence[float]) -> tuple[Track, ...]:
    """List the tracks of those instances that are not there at all of these times (seconds), in the order of `ids`."""
    table, actors = document.scene.table, document.scene.actors
    tracks = (actors[table[i].node - 1] for i in ids if table[i].node)
    ends = (min(times), max(times)) if times else ()
    return tuple(track for track in tracks if not all(track.covers(time) for time in ends))


def find_time_there(document: Document, ids: Collection[int], times: Sequence[float], time: float) -> float:
    """Find the time nearest to `time`, of these times (seconds), at which any of the instances is there.

    Returns `time` itself where something of them is there then, and where there is no such time.
    """
    tracks = list_passing(document, ids, (*times, time))
    if len(tracks) < len(ids) or any(track.covers(time) for track in tracks):
        return time
    there = [each for each in times if any(track.covers(each) for track in tracks)]
    return float(there[np.argmin(np.abs(np.array(there) - time))]) if there else time
