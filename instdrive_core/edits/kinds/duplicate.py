"""Duplicating instances."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from instdrive_core.edits.bases.append import Addition, AppendEdit, make_unique_track_id
from instdrive_core.edits.bases.editable import find_editable_parts
from instdrive_core.edits.bases.parameters import check_ids, check_vector
from instdrive_core.edits.bases.relabel import create_instances
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import describe_ids
from instdrive_core.maths.vectors import Vector
from instdrive_core.scene.scene import Scene
from instdrive_core.wording import phrase


@dataclass
class DuplicateInstances(AppendEdit):
    """Copies with IDs of their own, moved and coloured as the originals are; of an actor the drive is copied, too."""

    kind: ClassVar[str] = "duplicate_instances"
    ids: tuple[int, ...]
    translation: Vector = (0.0, 0.0, 0.0)
    """Metres in the world from the originals to the copies."""

    def __post_init__(self) -> None:
        self.ids = check_ids(self.ids)
        self.translation = check_vector(self.translation, "translation")

    @property
    def title(self) -> str:
        """``Duplicate instance 17``."""
        return phrase("Duplicate {objects}", objects=describe_ids(self.ids))

    @property
    def shift(self) -> Vector:
        """The translation."""
        return self.translation

    def build_addition(self, document: Document) -> Addition:
        """The rows that are neither deleted nor locked."""
        scene = document.scene
        parts = find_editable_parts(document, self.ids)
        rows = parts.rows
        copies = create_instances(document, [scene.table[instance_id] for instance_id in self.ids])
        nodes = sorted(set(np.unique(scene.nodes[rows]).tolist()) - {0})
        renumbered = np.zeros(len(scene.actors) + 1, np.uint16)
        renumbered[nodes] = len(scene.actors) + 1 + np.arange(len(nodes))
        taken, tracks = {track.id for track in scene.actors}, []
        for node in nodes:
            track = scene.actors[node - 1]
            tracks.append(replace(track, id=make_unique_track_id(f"{track.id} copy", taken)))
            taken.add(tracks[-1].id)
        added = Scene(
            scene.gaussians.select(rows),
            np.repeat(np.array([entry.id for entry in copies], np.uint32), parts.sizes),
            scene.codewords[rows],
            renumbered[scene.nodes[rows]],
            actors=(*scene.actors, *tracks),
            extra={name: column[rows] for name, column in scene.extra.items()},
        )
        entries = tuple(replace(entry, node=int(renumbered[entry.node])) for entry in copies)
        return Addition(added, document.colors.indices[rows], document.transforms.indices[rows], entries, tuple(tracks))
