"""Adjusting colours to absolute amounts: what a slider shows is how far it is from neutral, whatever was done before.

The last amount of each kind counts. An instance's palette entry remembers the colours before adjustment, and the
amounts. The editor, the command line and Python all adjust by `SetAdjustment`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from typing import ClassVar

import numpy as np
from jaxtyping import Float, Float64, Int64
from numpy import ndarray

from instdrive_core.edits.bases.adjustments import NAMES, RANGES, AdjustKind, check_adjustment, compute_adjustment
from instdrive_core.edits.bases.editable import find_colorable_parts, find_editable_parts
from instdrive_core.edits.bases.parameters import check_ids
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import describe_ids
from instdrive_core.edits.document.entries import PartsChange
from instdrive_core.edits.document.row_kernels import keep_free_rows
from instdrive_core.edits.document.row_parts import RowParts
from instdrive_core.edits.document.synthetic_rows import drop_shadows
from instdrive_core.edits.kinds.color import ColorEdit
from instdrive_core.edits.queries.mean_colors import compute_mean_colors
from instdrive_core.scene.palette import DRAWN, pack_color_entries
from instdrive_core.scene.selection import Flag
from instdrive_core.wording import phrase

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
        self.ids = check_ids(self.ids)
        self.amount = check_adjustment(self.what, self.amount)

    @property
    def title(self) -> str:
        """``Set brightness of instance 17 to 1.3``."""
        unit = "°" if self.what == "hue" else ""
        return phrase(
            "Set {what} of {objects} to {amount:.3g}{unit}",
            what=NAMES[self.what],
            objects=describe_ids(self.ids),
            amount=self.amount,
            unit=unit,
        )

    def do(self, document: Document) -> bool:
        """Add the changed entries and point the instances' rows at them."""
        find_parts = find_editable_parts if self.what == "opacity" else find_colorable_parts
        parts = find_parts(document, self.ids)
        return self.assign(document, parts, self._make_change(document, parts))

    def _make_change(self, document: Document, parts: RowParts) -> PartsChange:
        palette = document.colors

        @cache
        def means() -> Float64[ndarray, "p 3"]:
            return compute_mean_colors(document.scene.gaussians, parts, palette.bases, palette.indices)

        def change(values: ndarray, part: Int64[ndarray, " k"]) -> ndarray:
            bases, adjusted = values[:, DRAWN : DRAWN + 12].reshape(-1, 3, 4), values[:, DRAWN + 12 :].copy()
            if self.what == "opacity":
                alphas = np.full(len(values), self.amount)
                return pack_color_entries(values[:, :12].reshape(-1, 3, 4), alphas, bases, adjusted)
            adjusted[:, ORDER.index(self.what)] = self.amount - RANGES[self.what].neutral
            matrices = compose_adjustments(bases, adjusted, lambda: means()[part])
            return pack_color_entries(matrices, values[:, DRAWN - 1], bases, adjusted)

        return change


def compose_adjustments(
    bases: Float[ndarray, "k 3 4"], adjusted: Float[ndarray, "k a"], means: Callable[[], Float64[ndarray, "k 3"]]
) -> Float64[ndarray, "k 3 4"]:
    """Maps [A | b] of colours: `bases`, then the adjustments, which are given by their distances from neutral.

    `means` is asked, where there is contrast, for the mean colours before any adjustment; contrast keeps what the other
    adjustments make of them.
    """
    # Entries are many, but what they were adjusted by is seldom more than a few different things.
    different, place = np.unique(adjusted[:, :-1].astype(np.float64), axis=0, return_inverse=True)
    linear = np.array([_compose_linear(offsets.tolist()) for offsets in different])[place.reshape(-1)]
    matrices = linear @ bases.astype(np.float64)
    contrasts = adjusted[:, -1].astype(np.float64)
    if contrasts.any():
        amounts = RANGES["contrast"].neutral + contrasts
        middles = (linear @ means()[:, :, None])[:, :, 0]
        matrices *= amounts[:, None, None]
        matrices[:, :, 3] += (1 - amounts)[:, None] * middles
    return matrices


def _compose_linear(offsets: list[float]) -> Float64[ndarray, "3 3"]:
    """Matrix of all adjustments but contrast."""
    linear = np.eye(3)
    for kind, offset in zip(ORDER, offsets, strict=False):
        if offset:
            linear = compute_adjustment(kind, RANGES[kind].neutral + offset, np.zeros(3))[:, :3] @ linear
    return linear


@dataclass(frozen=True)
class AdjustmentSummary:
    """The adjustments that instances show now."""

    amounts: dict[AdjustKind, tuple[float, ...]]
    """Distinct amounts of each adjustment, rising: a single one where all splats agree."""
    recolored: bool
    """Whether any splat was recoloured or adjusted at all."""


def summarize_adjustments(document: Document, ids: Iterable[int]) -> AdjustmentSummary:
    """Adjustments that instances show now, deleted splats left out. Raises EditError for an unknown ID."""
    rows = drop_shadows(document, document.find_rows(ids))
    palette = document.colors
    alive = keep_free_rows(rows, np.array([0, len(rows)]), document.state.flags, np.uint8(Flag.DELETED))[0]
    named = np.zeros(len(palette), bool)
    named[palette.indices[alive]] = True
    entries = np.flatnonzero(named)
    columns: dict[AdjustKind, ndarray] = {"opacity": palette.alphas[entries]}
    for number, kind in enumerate(ORDER):
        columns[kind] = RANGES[kind].neutral + palette.adjusted[entries, number].astype(np.float64)
    amounts: dict[AdjustKind, tuple[float, ...]] = {
        kind: tuple(np.unique(columns[kind].astype(np.float32)).tolist()) for kind in RANGES
    }
    return AdjustmentSummary(amounts, recolored=bool(entries.any()))
