"""Absorbing floaters: strays in and around a car become the car's, and vanish with it where it is deleted."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy import ndarray

from instdrive_core.edits.base import checked_ids
from instdrive_core.edits.document import Document
from instdrive_core.edits.flags import FlagChange
from instdrive_core.edits.instances import RelabelEdit, Relabeling, known_instance
from instdrive_core.errors import EditError
from instdrive_core.instances.floaters import floaters_of_body
from instdrive_core.instances.interiors import DEFAULT_CONFIG, Body, body_of_points
from instdrive_core.instances.table import Instance
from instdrive_core.maths.activations import sigmoid
from instdrive_core.maths.spherical_harmonics import color_from_dc
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.transforms import current_means

_REACH = 1.5
"""Rows up to this factor of the hull's radius, and a metre, are looked at: more than `FloaterConfig` can ask for."""


@dataclass
class AbsorbFloaters(RelabelEdit):
    """Strays in and close around a compact instance become its own; around a deleted one they are deleted, too."""

    kind: ClassVar[str] = "absorb_floaters"
    id: int
    _flags_done: list[FlagChange] = field(default_factory=list, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        checked_ids((self.id,))

    @property
    def title(self) -> str:
        """``Absorb floaters of instance 17``."""
        return f"Absorb floaters of instance {self.id}"

    def relabelings(self, document: Document) -> list[Relabeling]:
        """The strays to the instance."""
        return [Relabeling(floaters_of(document, self.id), known_instance(document, self.id))]

    def do(self, document: Document) -> bool:
        """Relabel, and delete what joins a deleted instance."""
        gone = document.instance_flags(self.id).is_deleted
        if not super().do(document):
            return False
        self._flags_done = []
        if gone:
            for flag, on in ((Flag.SELECTED, False), (Flag.DELETED, True)):
                changed = document.state.change(_written(self), flag, on)
                self._flags_done.append(FlagChange(changed, flag, on))
        return True

    def undo(self, document: Document) -> None:
        """Bring back what was deleted, then the labels."""
        for rows, flag, on in reversed(self._flags_done):
            document.state.change(rows, flag, not on)
        super().undo(document)


def floaters_of(document: Document, instance_id: int) -> ndarray:
    """Rows that `AbsorbFloaters` would take: neither locked nor deleted, of the instance's node.

    Raises EditError where the instance is no compact body.
    """
    instance = known_instance(document, instance_id)
    scene, flags = document.scene, document.state.flags
    members = document.rows_of((instance_id,))
    alive = members[(flags[members] & Flag.DELETED) == 0]
    members = alive if len(alive) else members
    body = _body(document, instance_id, members)
    reach = np.float32(_REACH * body.reach + 1)
    means = current_means(scene.gaussians, document.transforms)
    offsets = means - body.center.astype(np.float32)
    near = np.flatnonzero((np.abs(offsets) <= reach).all(axis=1) & (scene.nodes == instance.node))
    free = (flags[near] & (Flag.DELETED | Flag.LOCKED)) == 0
    owned = np.isin(near, members, assume_unique=True)
    near, owned = near[free | owned], owned[free | owned]
    ids = scene.instance_ids[near]
    others = [other for other in np.unique(ids).tolist() if other in scene.table and other != instance_id]
    compact = [other for other in others if _is_compact(scene.table[other])]
    gaussians = scene.gaussians
    strays = floaters_of_body(body, means[near], color_from_dc(gaussians.sh_dc[near]), owned, np.isin(ids, compact))
    return near[strays & (ids != instance_id)]


def _body(document: Document, instance_id: int, members: ndarray) -> Body:
    gaussians = document.scene.gaussians
    solid = members[sigmoid(gaussians.opacity_logits[members]) >= DEFAULT_CONFIG.min_opacity]
    body = None
    if len(solid) >= DEFAULT_CONFIG.min_gaussians:
        body = body_of_points(instance_id, document.means_of(solid).astype(np.float64))
    if body is None:
        raise EditError(
            f"instance {instance_id} is no compact body (at most {DEFAULT_CONFIG.max_length:g} m long, at least "
            f"{DEFAULT_CONFIG.min_height:g} m high), so nothing lies inside of it"
        )
    return body


def _is_compact(instance: Instance) -> bool:
    """Whether an instance's bounds are those of an object, not of a surface or a scrap."""
    low, high = np.array(instance.bounds)
    size = high - low
    large_enough = instance.count >= DEFAULT_CONFIG.min_gaussians and size[2] >= DEFAULT_CONFIG.min_height
    return bool(large_enough and size[:2].max() <= DEFAULT_CONFIG.max_length)


def _written(edit: RelabelEdit) -> ndarray:
    assert edit._rows is not None
    return edit._rows
