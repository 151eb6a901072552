"""The frame on screen, which knows what its pixels stand for, so that pointing needs no look at the splats."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np
from jaxtyping import Int32
from numpy import ndarray

from instdrive_app.state import FrameSnapshot, ViewMode
from instdrive_core.edits.document.document import Document
from instdrive_core.scene.selection import Flag


@dataclass(frozen=True)
class ShownFrame(FrameSnapshot):
    """A snapshot together with the winners of its pixels."""

    winner: Int32[ndarray, "h w"] = field(repr=False, compare=False)
    """Row of the splat that a click on a pixel means, -1 for none; a draft's array is smaller than the picture."""
    document: Document = field(repr=False, compare=False)
    rows_version: int = field(compare=False)
    """The document's `versions.rows` when the frame was drawn."""

    def read_row_at(self, x: float, y: float) -> int | None:
        """Row of the splat that a pixel stands for, -1 for none.

        None if the frame cannot tell: it is a draft, the document's rows have changed, or the pixel is outside.
        """
        column, row = int(np.floor(x)), int(np.floor(y))
        height, width = self.winner.shape
        inside = 0 <= column < width and 0 <= row < height
        if self.draft or not inside or self.rows_version != self.document.versions.rows:
            return None
        return int(self.winner[row, column])


def drop_winners(snapshot: FrameSnapshot) -> FrameSnapshot:
    """Make a plain snapshot of one that may be a `ShownFrame`, which holds its picture's winners."""
    return FrameSnapshot(**{entry.name: getattr(snapshot, entry.name) for entry in fields(FrameSnapshot)})


def find_shown_instance(document: Document, snapshot: FrameSnapshot, x: float, y: float) -> int | None:
    """Find the instance that a frame shows at a position (pixels), 0 for none.

    None if the frame cannot tell, also because what it shows has been hidden or deleted since.
    """
    if not isinstance(snapshot, ShownFrame) or snapshot.document is not document:
        return None
    if snapshot.view_mode is ViewMode.CENTERS:
        return None  # hardly anybody hits a dot: what is meant is what the splats show together
    row = snapshot.read_row_at(x, y)
    if row is None or row < 0:
        return None if row is None else 0
    if document.state.flags[row] & (Flag.HIDDEN | Flag.DELETED):
        return None
    return int(document.scene.instance_ids[row])
