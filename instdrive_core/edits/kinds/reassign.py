"""Giving the selected splats to another instance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from instdrive_core.edits.bases.editable import check_unlocked
from instdrive_core.edits.bases.parameters import check_ids
from instdrive_core.edits.bases.relabel import RelabelEdit, Relabeling, create_instances, get_instance
from instdrive_core.edits.document.document import Document
from instdrive_core.errors import EditError
from instdrive_core.instances.table import Instance
from instdrive_core.scene.selection import Flag
from instdrive_core.wording import phrase


@dataclass
class ReassignSelected(RelabelEdit):
    """The selected splats become part of an instance, of a new one, or of none."""

    kind: ClassVar[str] = "reassign_selected"
    into: int | None = None
    """Instance ID; None makes a new instance, 0 takes the splats out of theirs."""

    def __post_init__(self) -> None:
        if self.into is not None and self.into != 0:
            check_ids((self.into,))
        if self.into is False:
            raise EditError("instance ID False is not a whole number")

    @property
    def title(self) -> str:
        """``Reassign selection to instance 17``."""
        if self.into is None:
            return "New instance from selection"
        return (
            phrase("Reassign selection to instance {into}", into=self.into)
            if self.into
            else "Take selection out of its instance"
        )

    def plan_relabelings(self, document: Document) -> list[Relabeling]:
        """All selected rows to the one target."""
        rows = document.state.find_rows(Flag.SELECTED)
        if not len(rows):
            raise EditError("nothing is selected; select what to reassign first")
        if self.into == 0:
            return [Relabeling(rows, None)]
        nodes = np.unique(document.scene.nodes[rows]).tolist()
        if self.into is None:
            target = self._make_target(document, int(rows[0]))
        else:
            target = get_instance(document, self.into)
            check_unlocked(document, (self.into,))
        if nodes != [target.node]:
            raise EditError(
                "the selected splats move with another object than the instance that shall get them; "
                "only splats of one track, or of the background, can belong to one instance"
            )
        return [Relabeling(rows, target)]

    def _make_target(self, document: Document, row: int) -> Instance:
        """A new instance that takes after the first selected splat's."""
        scene = document.scene
        source = scene.table.instances.get(int(scene.instance_ids[row]))
        blank = Instance(0, "instance 0", int(scene.nodes[row]), int(scene.codewords[row]))
        return create_instances(document, [source or blank])[0]
