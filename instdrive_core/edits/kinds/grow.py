"""Growing and shrinking the selection by what lies near its border."""

from __future__ import annotations

import hashlib
import math
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import numpy as np
from jaxtyping import Float32, Int32, Int64
from numpy import ndarray

from instdrive_core.edits.bases.flags import FlagChange, FlagEdit, keep_selectable
from instdrive_core.edits.bases.parameters import is_number
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.fingerprint import CONTENT, Part, fingerprint
from instdrive_core.edits.queries.shown_means import compute_shown_means
from instdrive_core.errors import EditError
from instdrive_core.instances.proximity import estimate_spacing, find_rows_near
from instdrive_core.scene.selection import Flag
from instdrive_core.wording import phrase

_ENOUGH = 100
"""Selected splats that tell how far splats lie apart; with fewer all that are drawn are asked."""
_FALLBACK = 0.1
"""Metres, where a scene has too few splats to tell."""


class _Sides(NamedTuple):
    """Both sides of the selection's border."""

    means: Float32[ndarray, "n 3"]
    """Metres, in the world."""
    selected: ndarray
    """Drawn rows that are selected."""
    others: ndarray
    """Drawn rows that are not."""
    distance: float
    """Metres that count as near."""


@dataclass
class BorderEdit(FlagEdit):
    """An edit of what lies along the selection's border, by the distance between splats that are drawn."""

    selects_only: ClassVar[bool] = True
    distance: float | None = None
    """Metres between centres; None = as far as the selected splats lie apart."""
    time: float = 0.0
    """Seconds: moving objects are where they are then; those that are absent are left alone."""
    _found: tuple[bytes, Int32[ndarray, " k"]] | None = field(default=None, init=False, repr=False, compare=False)
    """Rows along the border, and what they were found in."""

    def __post_init__(self) -> None:
        if self.distance is not None and not (is_number(self.distance) and self.distance > 0):
            raise EditError(phrase("distance {distance!r} is no number of metres above 0", distance=self.distance))
        if not is_number(self.time):
            raise EditError(phrase("time {time!r} is no number of seconds", time=self.time))

    def prepare(self, document: Document) -> None:
        """Look along the border, which may take a second: `do` on an equal document is then quick.

        Give a frozen copy to do this on another thread. Raises EditError where nothing is selected.
        """
        self._found = (self._compute_key(document), self.search_border(document).astype(np.int32))

    def is_prepared_for(self, document: Document) -> bool:
        """Whether a document has the content that this edit was prepared for."""
        return self._found is not None and self._found[0] == self._compute_key(document)

    @abstractmethod
    def search_border(self, document: Document) -> Int64[ndarray, " k"]:
        """The rows that change sides. Raises EditError where nothing is selected."""

    def find_border(self, document: Document) -> Int32[ndarray, " k"]:
        """The rows along the border: found by `prepare`, or searched now where the document has changed since."""
        if not self.is_prepared_for(document):
            self.prepare(document)
        assert self._found is not None
        return self._found[1]

    def _compute_key(self, document: Document) -> bytes:
        """Equal where the same is found: by what is where, what is selected or hidden, and where actors are."""
        poses, present = document.scene.find_node_poses(self.time)
        digest = hashlib.blake2b(fingerprint(document, (*CONTENT, Part.VISIBILITY)), digest_size=16)
        for array in (poses, present):
            digest.update(np.ascontiguousarray(array).data)
        return digest.digest()

    def _find_sides(self, document: Document) -> _Sides:
        means, drawn = compute_shown_means(document, self.time)
        chosen = document.state.find_mask(Flag.SELECTED)
        selected = np.flatnonzero(drawn & chosen)
        if not len(selected):
            raise EditError("nothing is selected; select what to grow or to shrink first")
        distance = self.distance
        if distance is None:
            spacing = estimate_spacing(means[selected] if len(selected) >= _ENOUGH else means[drawn])
            distance = spacing if math.isfinite(spacing) else _FALLBACK
        return _Sides(means, selected, np.flatnonzero(drawn & ~chosen), distance)


@dataclass
class GrowSelection(BorderEdit):
    """Select, too, what lies near a selected splat and is not hidden, locked or deleted."""

    kind: ClassVar[str] = "grow_selection"

    @property
    def title(self) -> str:
        """``Grow selection by 0.2 m``."""
        if self.distance is None:
            return "Grow selection"
        return phrase("Grow selection by {distance:g} m", distance=self.distance)

    def plan_changes(self, document: Document) -> Iterator[FlagChange]:
        """Set the bit on the selection's neighbours."""
        yield FlagChange(self.find_border(document), Flag.SELECTED, True)

    def search_border(self, document: Document) -> Int64[ndarray, " k"]:
        """The neighbours that can be selected."""
        means, selected, others, distance = self._find_sides(document)
        return find_rows_near(means, keep_selectable(document.state, others), selected, distance)


@dataclass
class ShrinkSelection(BorderEdit):
    """Deselect what lies near a splat that is drawn and not selected."""

    kind: ClassVar[str] = "shrink_selection"

    @property
    def title(self) -> str:
        """``Shrink selection by 0.2 m``."""
        if self.distance is None:
            return "Shrink selection"
        return phrase("Shrink selection by {distance:g} m", distance=self.distance)

    def plan_changes(self, document: Document) -> Iterator[FlagChange]:
        """Clear the bit along the selection's border."""
        yield FlagChange(self.find_border(document), Flag.SELECTED, False)

    def search_border(self, document: Document) -> Int64[ndarray, " k"]:
        """The selected rows near others."""
        means, selected, others, distance = self._find_sides(document)
        return find_rows_near(means, selected, others, distance)
