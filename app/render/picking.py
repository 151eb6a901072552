"""Which instances are under a pixel of the frame shown, nearest in meaning first."""

from __future__ import annotations

from instdrive_app.state import FrameSnapshot
from instdrive_core.edits.document import Document


class Picker:
    def instances_at(self, document: Document, snapshot: FrameSnapshot, x: float, y: float) -> tuple[int, ...]:
        raise NotImplementedError
