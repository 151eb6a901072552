"""Counters of a document's changes, for caches of what was drawn or worked out from it."""

from __future__ import annotations

from typing import NamedTuple


class DocumentVersions(NamedTuple):
    """How often each part of a document has changed.

    Equal values mean that the same document shows the same; compare single fields where only they matter. They tell
    nothing about two documents: `fingerprint` does.
    """

    rows: int
    """Rises when splats are added, or taken away again by undo."""
    states: int
    """Rises when splats are selected, hidden, locked or deleted, or the other way round."""
    colors: int
    """Rises when splats are recoloured."""
    transforms: int
    """Rises when splats move in the frames of their nodes."""
    tracks: int
    """Rises when an actor's track changes."""
    table: int
    """Rises when the instance table or the instance IDs change."""
    surroundings: int
    """Rises when photo cameras, the sky or the orientation change."""

    @property
    def geometry(self) -> tuple[int, int]:
        """Changes when splats or tracks move."""
        return self.transforms, self.tracks
