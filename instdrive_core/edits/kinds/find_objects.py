"""Making instances in a scene that has none."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from jaxtyping import Int64, UInt32
from numpy import ndarray

from instdrive_core.edits.bases.parameters import is_number
from instdrive_core.edits.bases.relabel import RelabelEdit, Relabeling, create_instances
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.fingerprint import CONTENT, fingerprint
from instdrive_core.errors import EditError
from instdrive_core.instances.found_objects import DEFAULT_OBJECTS, estimate_unit, find_objects
from instdrive_core.maths.spherical_harmonics import color_from_dc
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.transforms import compute_current_means
from instdrive_core.wording import phrase


@dataclass(frozen=True)
class FoundRows:
    """Splats of no instance that make up objects, and of which document that holds."""

    content: bytes
    rows: Int64[ndarray, " n"]
    numbers: UInt32[ndarray, " n"]
    """1, 2, … by falling support."""
    nodes: tuple[int, ...]
    """Node of each object."""


@dataclass
class FindObjects(RelabelEdit):
    """What stands on the ground, hangs together and has the size of an object becomes an instance.

    Splats of instances, and deleted, hidden or locked ones, stay as they are. Of each moving object, whatever has no
    instance becomes one.
    """

    kind: ClassVar[str] = "find_objects"
    gap: float = DEFAULT_OBJECTS.gap
    """Metres: what is nearer to each other is one object; where colours are alike, up to three times that."""
    longest: float = DEFAULT_OBJECTS.longest
    """Metres: what is longer or wider is background."""
    unit: float | None = None
    """Length in the scene that is a metre on a street; None = 1, or less where the scene is smaller than a street."""
    _found: FoundRows | None = field(default=None, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        for name in ("gap", "longest", "unit"):
            value = getattr(self, name)
            if value is None and name == "unit":
                continue
            if not is_number(value) or not 0 < value < np.inf:
                raise EditError(phrase("{name} {value!r} is not a number above 0", name=name, value=value))
            setattr(self, name, float(value))

    @property
    def title(self) -> str:
        """``Find objects``."""
        return "Find objects"

    def prepare(self, document: Document) -> int:
        """Look for the objects, which takes about a second for a million splats: `do` on an equal document is then
        quick. Returns how many there are.

        Give a frozen copy to do this on another thread.
        """
        content = fingerprint(document, CONTENT)
        if self._found is None or self._found.content != content:
            self._found = self._look(document, content)
        return len(self._found.nodes)

    def is_prepared_for(self, document: Document) -> bool:
        """Whether the objects are known of a document with this content."""
        return self._found is not None and self._found.content == fingerprint(document, CONTENT)

    def plan_relabelings(self, document: Document) -> list[Relabeling]:
        """Each object to a new instance. Raises EditError where there is none."""
        count = self.prepare(document)
        assert self._found is not None
        if not count:
            raise EditError(
                "no object without an instance stands on the ground; the scene must be upright (Move > Turn upright, "
                "--up), and a smaller gap finds objects that touch one another"
            )
        targets = create_instances(document, [None] * count)
        order = np.argsort(self._found.numbers, kind="stable")
        bounds = np.searchsorted(self._found.numbers[order], np.arange(1, count + 2))
        return [
            Relabeling(np.sort(self._found.rows[order[bounds[k] : bounds[k + 1]]]), replace(target, node=node))
            for k, (target, node) in enumerate(zip(targets, self._found.nodes, strict=True))
        ]

    def _look(self, document: Document, content: bytes) -> FoundRows:
        scene, gaussians = document.scene, document.scene.gaussians
        alive = (document.state.flags & np.uint8(Flag.DELETED | Flag.HIDDEN)) == 0
        free = alive & ((document.state.flags & Flag.LOCKED) == 0) & (scene.instance_ids == 0)
        rows = np.flatnonzero(alive & (scene.nodes == 0))
        means = compute_current_means(gaussians, document.transforms)[rows]
        config = replace(DEFAULT_OBJECTS, gap=self.gap, alike_gap=3 * self.gap, longest=self.longest)
        numbers = find_objects(
            means,
            np.exp(np.clip(gaussians.log_scales[rows], -30, 30)),
            np.clip(color_from_dc(gaussians.sh_dc[rows]), 0, 1),
            gaussians.select(rows).opacities,
            free[rows],
            self.unit or estimate_unit(means),
            config,
        )
        kept = numbers > 0
        count = int(numbers.max(initial=0))
        all_rows, all_numbers, nodes = [rows[kept]], [numbers[kept]], [0] * count
        for node in np.unique(scene.nodes[free & (scene.nodes > 0)]).tolist():
            own = np.flatnonzero(free & (scene.nodes == node))
            nodes.append(int(node))
            all_rows.append(own)
            all_numbers.append(np.full(len(own), len(nodes), np.uint32))
        return FoundRows(content, np.concatenate(all_rows), np.concatenate(all_numbers), tuple(nodes))
