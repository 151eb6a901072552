"""Absorbing floaters: strays in and around a car become the car's, and vanish with it where it is deleted."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from jaxtyping import Int64
from numpy import ndarray

from instdrive_core.edits.bases.editable import check_unlocked
from instdrive_core.edits.bases.flags import FlagChange
from instdrive_core.edits.bases.parameters import check_ids
from instdrive_core.edits.bases.relabel import RelabelEdit, Relabeling, get_instance
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.fingerprint import CONTENT, fingerprint
from instdrive_core.edits.queries.compact_objects import build_body, is_compact, keep_main_node
from instdrive_core.errors import EditError
from instdrive_core.instances.floaters import DEFAULT_CONFIG as FLOATERS
from instdrive_core.instances.floaters import match_floaters
from instdrive_core.instances.interiors import DEFAULT_CONFIG, CompactObject
from instdrive_core.maths.spherical_harmonics import color_from_dc
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.transforms import compute_current_means, find_away
from instdrive_core.wording import phrase

_GROWTH, _SLACK = 1.2, 1.0
"""Rows in the body's box grown by a factor and metres are looked at: more than `FloaterConfig` can ask for."""
_ROUNDS = 8
_SCRAP_SHARE = 0.1
"""An instance with at most this share of a body's splats is a piece of it …"""
_SCRAP_MARGIN = 0.1
"""… where most of them are at most so many metres outside of it, …"""
_SCRAP_REACH = 0.7
"""… or so many where they are of its class."""


@dataclass
class AbsorbFloaters(RelabelEdit):
    """Strays in and close around a compact instance become its own; around a deleted one they are deleted, too."""

    kind: ClassVar[str] = "absorb_floaters"
    id: int
    _found: tuple[bytes, Int64[ndarray, " k"]] | None = field(default=None, init=False, repr=False, compare=False)
    _flags_done: list[FlagChange] = field(default_factory=list, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_ids((self.id,))

    @property
    def title(self) -> str:
        """``Absorb floaters of instance 17``."""
        return phrase("Absorb floaters of instance {id}", id=self.id)

    def prepare(self, document: Document) -> None:
        """Look for the strays, which may take a second: `do` on an equal document is then quick.

        Give a frozen copy to do this on another thread. Raises EditError where the instance is no compact body.
        """
        self._found = (fingerprint(document, CONTENT), find_instance_floaters(document, self.id))

    def is_prepared_for(self, document: Document) -> bool:
        """Whether the strays are known of a document with this content."""
        return self._found is not None and self._found[0] == fingerprint(document, CONTENT)

    def plan_relabelings(self, document: Document) -> list[Relabeling]:
        """The strays to the instance."""
        if not self.is_prepared_for(document):
            self.prepare(document)
        assert self._found is not None
        return [Relabeling(self._found[1], get_instance(document, self.id))]

    def do(self, document: Document) -> bool:
        """Relabel, and delete what joins a deleted instance."""
        gone = document.summarize_instance(self.id).is_deleted
        if not super().do(document):
            return False
        self._flags_done = []
        if gone:
            assert self._rows is not None
            for flag, on in ((Flag.SELECTED, False), (Flag.DELETED, True)):
                changed = document.state.change(self._rows, flag, on)
                self._flags_done.append(FlagChange(changed, flag, on))
        return True

    def undo(self, document: Document) -> None:
        """Bring back what was deleted, then the labels."""
        for rows, flag, on in reversed(self._flags_done):
            document.state.change(rows, flag, not on)
        super().undo(document)


def find_instance_floaters(document: Document, instance_id: int) -> ndarray:
    """Rows that `AbsorbFloaters` would take: neither locked nor deleted, of the instance's node.

    Raises EditError where the instance is locked or no compact body.
    """
    get_instance(document, instance_id)
    check_unlocked(document, (instance_id,))
    flags = document.state.flags
    members = document.find_rows((instance_id,))
    alive = members[(flags[members] & Flag.DELETED) == 0]
    members = keep_main_node(document, alive if len(alive) else members)
    if build_body(document, instance_id, members) is None:
        raise EditError(
            phrase(
                "instance {instance_id} is no compact body (at most {max_length:g} m long, at least "
                "{min_height:g} m high), so nothing lies inside of it",
                instance_id=instance_id,
                max_length=DEFAULT_CONFIG.max_length,
                min_height=DEFAULT_CONFIG.min_height,
            )
        )
    return find_floaters_around(document, instance_id, members)


def find_floaters_around(
    document: Document, instance_id: int, members: Int64[ndarray, " m"], kept: Int64[ndarray, " s"] | None = None
) -> Int64[ndarray, " k"]:
    """Strays in and around the body of some rows of one instance, rising; none where they span no body.

    `kept` are rows of the instance that are no strays though they lie there. What joins a body may make it larger, so
    that more lies inside: looked for until nothing is left, a few times.
    """
    members, found = keep_main_node(document, members), np.zeros(0, np.int64)
    kept = np.zeros(0, np.int64) if kept is None else kept
    for _ in range(_ROUNDS):
        joined = _find_strays(document, instance_id, np.concatenate([members, found]), kept)
        if not len(joined):
            break
        found = np.concatenate([found, joined])
    return np.sort(found)


def find_rows_close_to(
    document: Document, instance_id: int, members: Int64[ndarray, " m"], rows: Int64[ndarray, " n"]
) -> Int64[ndarray, " k"]:
    """Those of `rows` that lie in or close around the body that `members` span; none where they span none.

    Beside the body only what is clear of the ground counts: the ground there belongs to the hole.
    """
    members = keep_main_node(document, members)
    body = build_body(document, instance_id, members)
    if body is None:
        return np.zeros(0, np.int64)
    local = (document.compute_means(rows).astype(np.float64) - body.center) @ body.axes
    clear = local[:, 2] > body.floor + FLOATERS.margin
    beside = body.holds(local, FLOATERS.growth, FLOATERS.margin) & clear
    return rows[beside | (body.holds(local) & (local[:, 2] > body.floor))]


def _find_strays(
    document: Document, instance_id: int, members: Int64[ndarray, " m"], kept: Int64[ndarray, " s"]
) -> Int64[ndarray, " k"]:
    scene, flags = document.scene, document.state.flags
    body = build_body(document, instance_id, members)
    if body is None:
        return np.zeros(0, np.int64)
    near = _find_rows_around(document, body, members)
    owned = np.isin(near, members)
    free = ((flags[near] & (Flag.DELETED | Flag.LOCKED)) == 0) & ~find_away(document.transforms, near)
    near, owned = near[free | owned], owned[free | owned]
    ids = scene.instance_ids[near]
    others = [other for other in np.unique(ids).tolist() if other in scene.table and other != instance_id]
    scraps = _find_scraps(document, body, others, near, members)
    compact = [other for other in others if is_compact(scene.table[other]) and other not in scraps]
    colors = color_from_dc(scene.gaussians.sh_dc[near])
    strays = match_floaters(body, document.compute_means(near), colors, owned, np.isin(ids, compact))
    return near[(strays | np.isin(ids, scraps)) & ~owned & ~np.isin(near, kept)]


def _find_rows_around(document: Document, body: CompactObject, members: Int64[ndarray, " m"]) -> Int64[ndarray, " k"]:
    """Rows of the body's node in a box around it that holds all that can be asked about, and their neighbours."""
    scene = document.scene
    means = compute_current_means(scene.gaussians, document.transforms)
    reach = np.float32(_GROWTH * body.reach + _SLACK)
    offsets = np.abs(means - body.center.astype(np.float32))
    rows = np.flatnonzero((offsets <= reach).all(axis=1) & (scene.nodes == scene.nodes[members[0]]))
    own = (means[members].astype(np.float64) - body.center) @ body.axes
    low, high = np.quantile(own, [DEFAULT_CONFIG.stray_share, 1 - DEFAULT_CONFIG.stray_share], axis=0)
    low, high = _GROWTH * low - _SLACK, _GROWTH * high + _SLACK
    low[2] = body.floor - _SLACK
    local = (means[rows].astype(np.float64) - body.center) @ body.axes
    return rows[((local >= low) & (local <= high)).all(axis=1)]


def _find_scraps(
    document: Document,
    body: CompactObject,
    others: list[int],
    near: Int64[ndarray, " k"],
    members: Int64[ndarray, " m"],
) -> list[int]:
    """Instances that are pieces of a body with a label of their own: few splats, most of them inside of it, or of its
    class and close around it."""
    scene = document.scene
    own = scene.table.instances.get(int(scene.instance_ids[members[0]]))
    scraps = []
    for other in others:
        count = len(document.find_rows((other,)))
        if count > max(_SCRAP_SHARE * len(members), 1):
            continue
        alike = own is not None and own.class_name != "" and scene.table[other].class_name == own.class_name
        rows = near[scene.instance_ids[near] == other]
        local = (document.compute_means(rows).astype(np.float64) - body.center) @ body.axes
        inside = body.holds(local, margin=_SCRAP_REACH if alike else _SCRAP_MARGIN)
        if np.count_nonzero(inside) > count / 2:
            scraps.append(other)
    return scraps
