"""Adjusting colours to absolute amounts: how far each slider is from neutral, whatever was done before.

`AdjustInstances` works on what is shown, and adjustments add up; here the last amount of each kind counts. What an
instance is made of is remembered by its palette entry: the colours before adjustment, and the amounts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from typing import ClassVar

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from instdrive_core.edits.adjustments import RANGES, AdjustKind, adjustment, checked_adjustment
from instdrive_core.edits.base import ids_in_words
from instdrive_core.edits.color import ColorEdit, mean_color
from instdrive_core.edits.delete import editable
from instdrive_core.edits.document import Document
from instdrive_core.edits.parameters import checked_ids
from instdrive_core.scene.palette import DRAWN, color_values
from instdrive_core.scene.selection import Flag

ORDER: tuple[AdjustKind, ...] = ("temperature", "hue", "saturation", "brightness", "contrast")
"""In which adjustments are done, and in which a palette entry remembers them; opacity is a number of its own."""


@dataclass
class SetAdjustment(ColorEdit):
    """Set one adjustment of instances to an amount, over their trained colours or their last recolour."""

    kind: ClassVar[str] = "set_adjustment"
    ids: tuple[int, ...]
    what: AdjustKind
    amount: float
    """Degrees for `hue` (-180 … 180), -1 … 1 for `temperature` (warm above 0), else a factor (0 … 4; opacity 0 … 1)."""

    def __post_init__(self) -> None:
        self.ids = checked_ids(self.ids)
        self.amount = checked_adjustment(self.what, self.amount)

    @property
    def title(self) -> str:
        """``Set brightness of instance 17 to 1.3``."""
        unit = "°" if self.what == "hue" else ""
        return f"Set {self.what} of {ids_in_words(self.ids)} to {self.amount:.3g}{unit}"

    def do(self, document: Document) -> bool:
        """Add the changed entries and point the instances' rows at them."""
        parts = [editable(document, (instance_id,)) for instance_id in self.ids]
        return self.assign(document, [(rows, self._change(document, rows)) for rows in parts])

    def _change(self, document: Document, rows: ndarray) -> Callable[[ndarray], ndarray]:
        @cache
        def mean() -> Float64[ndarray, "3"]:
            return base_mean(document, rows)

        def change(values: ndarray) -> ndarray:
            base, adjusted = values[DRAWN : DRAWN + 12].reshape(3, 4), values[DRAWN + 12 :].copy()
            if self.what == "opacity":
                return color_values(values[:12].reshape(3, 4), self.amount, base, adjusted)
            adjusted[ORDER.index(self.what)] = self.amount - RANGES[self.what].neutral
            return color_values(composed(base, adjusted, mean), float(values[DRAWN - 1]), base, adjusted)

        return change


def composed(
    base: Float[ndarray, "3 4"], adjusted: Float[ndarray, " a"], mean: Callable[[], Float64[ndarray, "3"]]
) -> Float64[ndarray, "3 4"]:
    """The map [A | b] of colours: `base`, then the adjustments, which are given by their distances from neutral.

    `mean` is asked, where there is contrast, for the mean colour before any adjustment; contrast keeps what the other
    adjustments make of it.
    """
    *linear_offsets, contrast = adjusted.astype(np.float64).tolist()
    linear = np.eye(3)
    for kind, offset in zip(ORDER, linear_offsets, strict=False):
        if offset:
            linear = adjustment(kind, RANGES[kind].neutral + offset, np.zeros(3))[:, :3] @ linear
    matrix = linear @ base.astype(np.float64)
    if contrast:
        step = adjustment("contrast", RANGES["contrast"].neutral + contrast, linear @ mean())
        matrix = step[:, :3] @ matrix
        matrix[:, 3] += step[:, 3]
    return matrix


def base_mean(document: Document, rows: ndarray) -> Float64[ndarray, "3"]:
    """The mean of the rows' colours before adjustment, without view dependence, weighted by opacity."""
    palette = document.colors
    return mean_color(document.scene.gaussians, rows, palette.bases, palette.indices[rows])


@dataclass(frozen=True)
class Look:
    """How instances are coloured now."""

    amounts: dict[AdjustKind, tuple[float, ...]]
    """Of each adjustment the distinct amounts, rising: one where all splats agree."""
    recolored: bool
    """Whether any splat was recoloured or adjusted at all."""


def look_of(document: Document, ids: Iterable[int]) -> Look:
    """The look of instances, deleted splats left out. Raises EditError for an unknown ID."""
    rows = document.rows_of(ids)
    palette = document.colors
    alive = palette.indices[rows][(document.state.flags[rows] & Flag.DELETED) == 0]
    entries = np.flatnonzero(np.bincount(alive, minlength=1))
    columns: dict[AdjustKind, ndarray] = {"opacity": palette.alphas[entries]}
    for number, kind in enumerate(ORDER):
        columns[kind] = RANGES[kind].neutral + palette.adjusted[entries, number].astype(np.float64)
    amounts: dict[AdjustKind, tuple[float, ...]] = {
        kind: tuple(np.unique(columns[kind].astype(np.float32)).tolist()) for kind in RANGES
    }
    return Look(amounts, recolored=bool(entries.any()))
