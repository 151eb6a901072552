"""Giving a moving object another way."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from instdrive_core.edits.bases.driven_track import Keys, check_keys, drive_along
from instdrive_core.edits.bases.editable import check_unlocked
from instdrive_core.edits.bases.parameters import check_ids
from instdrive_core.edits.bases.poses import PoseEdit
from instdrive_core.edits.bases.relabel import get_instance
from instdrive_core.edits.document.document import Document
from instdrive_core.errors import EditError
from instdrive_core.wording import phrase


@dataclass
class SetPath(PoseEdit):
    """Let a moving object drive a way on the ground; with a single key it is parked there.

    It is there over the whole drive: before the first key and after the last one it stands.
    """

    kind: ClassVar[str] = "set_path"
    id: int
    keys: Keys
    """(time, x, y) or (time, x, y, heading) each: seconds, metres in the scene, radians; times rise."""

    def __post_init__(self) -> None:
        (self.id,) = check_ids((self.id,))
        self.keys = check_keys(self.keys)

    @property
    def title(self) -> str:
        """``Drive instance 17 another way`` or ``Park instance 17``."""
        return (
            phrase("Park instance {id}", id=self.id)
            if len(self.keys) == 1
            else phrase("Drive instance {id} another way", id=self.id)
        )

    def do(self, document: Document) -> bool:
        """Replace the track; every instance of the actor goes along."""
        scene, node = document.scene, get_instance(document, self.id).node
        if not node:
            raise EditError(phrase("instance {id} stands still; let it start driving instead", id=self.id))
        sharing = [entry.id for entry in scene.table if entry.node == node]
        check_unlocked(document, sharing)
        track = scene.actors[node - 1]
        middle = track.interpolate_pose(float(track.times[len(track.times) // 2]))
        driven = drive_along(document, sharing, self.keys, middle, float(track.dimensions[2]), track)
        empty = np.zeros(0, np.int64)
        size = len(document.transforms)
        self.assign_poses(document, empty, np.zeros(0, np.uint16), {node: driven}, sharing, size)
        return True
