"""Adjustments that add up, as projects of version 0.1.0 may hold them; new ones are absolute (`SetAdjustment`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Int64
from numpy import ndarray

from instdrive_core.edits.bases.adjustments import NAMES, RANGES, AdjustKind, check_adjustment, compute_adjustment
from instdrive_core.edits.bases.editable import find_editable_parts
from instdrive_core.edits.bases.parameters import check_ids
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import describe_ids
from instdrive_core.edits.document.entries import PartsChange
from instdrive_core.edits.document.row_parts import RowParts
from instdrive_core.edits.kinds.color import ColorEdit
from instdrive_core.edits.queries.mean_colors import compute_mean_colors
from instdrive_core.scene.palette import DRAWN, pack_color_entries
from instdrive_core.wording import phrase


@dataclass
class AdjustInstances(ColorEdit):
    """Change one property of the colours that instances show now, recolours included; adjustments add up."""

    kind: ClassVar[str] = "adjust_instances"
    ids: tuple[int, ...]
    what: AdjustKind
    amount: float
    """Degrees for `hue` (-180 … 180), -1 … 1 for `temperature` (warm above 0), else a factor (0 … 4; opacity 0 … 1)."""

    def __post_init__(self) -> None:
        self.ids = check_ids(self.ids)
        self.amount = check_adjustment(self.what, self.amount)

    @property
    def title(self) -> str:
        """``Adjust hue of instance 17``."""
        return phrase("Adjust {what} of {objects}", what=NAMES[self.what], objects=describe_ids(self.ids))

    def do(self, document: Document) -> bool:
        """Add the changed entries and point the instances' rows at them."""
        parts = find_editable_parts(document, self.ids)
        if self.amount == RANGES[self.what].neutral:
            return False
        return self.assign(document, parts, self._make_change(document, parts))

    def _make_change(self, document: Document, parts: RowParts) -> PartsChange:
        means = np.zeros((len(parts), 3))
        if self.what == "contrast":
            means = compute_mean_colors(
                document.scene.gaussians, parts, document.colors.matrices, document.colors.indices
            )
        linear = compute_adjustment(self.what, self.amount, np.zeros(3))[:, :3]
        offsets = (1 - self.amount) * means  # of contrast, the only adjustment that has any
        factor = self.amount if self.what == "opacity" else 1.0

        def change(values: ndarray, part: Int64[ndarray, " k"]) -> ndarray:
            after = linear @ values[:, : DRAWN - 1].reshape(-1, 3, 4).astype(np.float64)
            after[:, :, 3] += offsets[part]
            return pack_color_entries(after, values[:, DRAWN - 1].astype(np.float64) * factor)

        return change
