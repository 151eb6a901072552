"""Splitting an instance into the parts that do not hang together."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from jaxtyping import Float32, Int64, UInt32
from numpy import ndarray

from instdrive_core.edits.bases.editable import find_editable_rows
from instdrive_core.edits.bases.parameters import check_ids, is_number
from instdrive_core.edits.bases.relabel import RelabelEdit, Relabeling, create_instances, get_instance
from instdrive_core.edits.document.document import Document
from instdrive_core.errors import EditError
from instdrive_core.instances.components import ComponentConfig, split_components
from instdrive_core.instances.rejoining import RejoinConfig
from instdrive_core.scene.selection import Flag
from instdrive_core.wording import phrase

DEFAULT_GAP = 1.0


@dataclass(frozen=True)
class InstanceParts:
    """The spatial parts of an instance, and the rows and means that they were found from."""

    rows: Int64[ndarray, " n"]
    means: Float32[ndarray, "n 3"]
    numbers: UInt32[ndarray, " n"]
    """1 for the largest part, then falling; 0 for what is too faint to be one (it stays with the instance)."""

    @property
    def sizes(self) -> tuple[int, ...]:
        """How many splats each part would have, the one that keeps the ID first."""
        faint, *sizes = np.bincount(self.numbers, minlength=2).tolist()
        return (sizes[0] + faint, *sizes[1:])

    def hold_for(self, rows: ndarray, means: ndarray) -> bool:
        """Whether these are the splats that they were found from, where they were."""
        return np.array_equal(rows, self.rows) and np.array_equal(means, self.means)


@dataclass
class SplitInstance(RelabelEdit):
    """The largest spatial part of an instance keeps its ID, the others become instances of their own."""

    kind: ClassVar[str] = "split_instance"
    id: int
    gap: float = DEFAULT_GAP
    """Metres: parts farther apart are different things, dense ones already at three times their own spacing; the
    extents of the splats come on top."""
    _found: InstanceParts | None = field(default=None, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_ids((self.id,))
        if not is_number(self.gap) or self.gap <= 0:
            raise EditError(phrase("gap {gap!r} is not a number of metres above 0", gap=self.gap))
        self.gap = float(self.gap)

    @property
    def title(self) -> str:
        """``Split instance 17``."""
        return phrase("Split instance {id}", id=self.id)

    def is_prepared_for(self, document: Document) -> bool:
        """Whether the parts are known as they are in this document."""
        if self._found is None or self.id not in document.scene.table:
            return False
        rows = document.find_rows((self.id,))
        free = rows[(document.state.flags[rows] & (Flag.DELETED | Flag.LOCKED)) == 0]
        return self._found.hold_for(free, document.compute_means(free))

    def prepare(self, document: Document) -> tuple[int, ...]:
        """Look for the parts, which may take a second: `do` on an equal document is then quick. Returns their sizes.

        Give a frozen copy to do this on another thread. Raises EditError for an unknown instance.
        """
        self._found = find_parts(document, self.id, self.gap, self._found)
        return self._found.sizes

    def plan_relabelings(self, document: Document) -> list[Relabeling]:
        """The second largest part and those after it, each to a new instance."""
        source = get_instance(document, self.id)
        self.prepare(document)
        assert self._found is not None
        rows, parts = self._found.rows, self._found.numbers
        count = int(parts.max(initial=0))
        if count < 2:
            raise EditError(
                phrase("instance {id} hangs together at gaps of {gap:g} m; try a smaller gap", id=self.id, gap=self.gap)
            )
        pieces = [rows[parts == number] for number in range(2, count + 1)]
        return [
            Relabeling(*pair) for pair in zip(pieces, create_instances(document, [source] * len(pieces)), strict=True)
        ]


def find_parts(document: Document, instance_id: int, gap: float, known: InstanceParts | None = None) -> InstanceParts:
    """The parts of an instance, `known` where they still hold. Raises EditError for an unknown ID."""
    rows = find_editable_rows(document, (instance_id,))
    means = document.compute_means(rows)
    if known is not None and known.hold_for(rows, means):
        return known
    # The user asks for parts: nothing is joined again across gaps, and an actor is no longer taken to be whole.
    config = ComponentConfig(max_gap=gap, sparse_limit=gap, rejoin=RejoinConfig(max_gap=0.0, gap_times_support=0.0))
    gaussians, apart = document.scene.gaussians, document.scene.nodes[rows].astype(np.uint32)
    scales, opacities = np.exp(gaussians.log_scales[rows]), gaussians.select(rows).opacities
    numbers = split_components(means, scales, np.zeros(len(rows), np.uint16), apart, opacities, config)
    return InstanceParts(rows, means, numbers)
