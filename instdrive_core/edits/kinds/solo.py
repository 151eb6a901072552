"""Showing some instances alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from instdrive_core.edits.bases.flags import FlagChange, FlagEdit
from instdrive_core.edits.bases.parameters import check_ids
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import describe_ids
from instdrive_core.scene.selection import Flag
from instdrive_core.wording import phrase


@dataclass
class SoloInstances(FlagEdit):
    """Show these instances and hide all else, splats of no instance included."""

    kind: ClassVar[str] = "solo_instances"
    ids: tuple[int, ...]

    def __post_init__(self) -> None:
        self.ids = check_ids(self.ids)

    @property
    def title(self) -> str:
        """``Show only instance 17``."""
        return phrase("Show only {objects}", objects=describe_ids(self.ids))

    def plan_changes(self, document: Document) -> Iterator[FlagChange]:
        """Show the instances, then deselect and hide the others; what is deleted keeps its bits."""
        alive = ~document.state.find_mask(Flag.DELETED)
        wanted = np.zeros(len(alive), bool)
        wanted[document.find_rows(self.ids)] = True
        others = np.flatnonzero(alive & ~wanted)
        yield FlagChange(np.flatnonzero(alive & wanted), Flag.HIDDEN, False)
        yield FlagChange(others, Flag.SELECTED, False)
        yield FlagChange(others, Flag.HIDDEN, True)
