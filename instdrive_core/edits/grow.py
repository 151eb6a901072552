"""Growing and shrinking the selection by what lies near its border."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Bool, Float32
from numpy import ndarray

from instdrive_core.edits.document import Document
from instdrive_core.edits.flags import FlagChange, FlagEdit, selectable
from instdrive_core.edits.shown_means import shown_means
from instdrive_core.errors import EditError
from instdrive_core.instances.nearness import rows_near, spacing_of
from instdrive_core.scene.selection import Flag

_ENOUGH = 100
"""Selected splats that tell how far splats lie apart; with fewer all that are drawn are asked."""
_FALLBACK = 0.1
"""Metres, where a scene has too few splats to tell."""


@dataclass
class GrowSelection(FlagEdit):
    """Select, too, what lies near a selected splat and is not hidden, locked or deleted."""

    kind: ClassVar[str] = "grow_selection"
    selects_only: ClassVar[bool] = True
    distance: float | None = None
    """Metres between centres; None = as far as the selected splats lie apart."""
    time: float = 0.0
    """Seconds: moving objects are where they are then; those that are absent are not selected."""

    def __post_init__(self) -> None:
        _check(self.distance, self.time)

    @property
    def title(self) -> str:
        """``Grow selection by 0.2 m``."""
        return f"Grow selection{_by(self.distance)}"

    def changes(self, document: Document) -> Iterator[FlagChange]:
        """Set the bit on the selection's neighbours."""
        means, drawn = shown_means(document, self.time)
        selected, others = _both_sides(document, drawn)
        distance = _distance(means, drawn, selected, self.distance)
        near = rows_near(means, selectable(document.state, others), selected, distance)
        yield FlagChange(near, Flag.SELECTED, True)


@dataclass
class ShrinkSelection(FlagEdit):
    """Deselect what lies near a splat that is drawn and not selected."""

    kind: ClassVar[str] = "shrink_selection"
    selects_only: ClassVar[bool] = True
    distance: float | None = None
    """As for `GrowSelection`."""
    time: float = 0.0
    """As for `GrowSelection`."""

    def __post_init__(self) -> None:
        _check(self.distance, self.time)

    @property
    def title(self) -> str:
        """``Shrink selection by 0.2 m``."""
        return f"Shrink selection{_by(self.distance)}"

    def changes(self, document: Document) -> Iterator[FlagChange]:
        """Clear the bit along the selection's border."""
        means, drawn = shown_means(document, self.time)
        selected, others = _both_sides(document, drawn)
        distance = _distance(means, drawn, selected, self.distance)
        yield FlagChange(rows_near(means, selected, others, distance), Flag.SELECTED, False)


def _both_sides(document: Document, drawn: Bool[ndarray, " n"]) -> tuple[ndarray, ndarray]:
    """Drawn rows that are selected, and drawn rows that are not."""
    chosen = document.state.mask(Flag.SELECTED)
    selected = np.flatnonzero(drawn & chosen)
    if not len(selected):
        raise EditError("nothing is selected; select what to grow or to shrink first")
    return selected, np.flatnonzero(drawn & ~chosen)


def _distance(
    means: Float32[ndarray, "n 3"], drawn: Bool[ndarray, " n"], selected: ndarray, distance: float | None
) -> float:
    if distance is not None:
        return distance
    spacing = spacing_of(means[selected] if len(selected) >= _ENOUGH else means[drawn])
    return spacing if math.isfinite(spacing) else _FALLBACK


def _by(distance: float | None) -> str:
    return "" if distance is None else f" by {distance:g} m"


def _check(distance: float | None, time: float) -> None:
    if distance is not None and not (_is_number(distance) and distance > 0):
        raise EditError(f"distance {distance!r} is no number of metres above 0")
    if not _is_number(time):
        raise EditError(f"time {time!r} is no number of seconds")


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
