"""Adjusting the colours of instances on top of what they are: hue, brightness, contrast, saturation and so on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.edits.adjustments import RANGES, AdjustKind, adjustment, checked_adjustment
from instdrive_core.edits.base import ids_in_words
from instdrive_core.edits.color import ColorEdit, mean_color
from instdrive_core.edits.delete import editable
from instdrive_core.edits.document import Document
from instdrive_core.edits.parameters import checked_ids
from instdrive_core.scene.palette import color_values


@dataclass
class AdjustInstances(ColorEdit):
    """Change one property of the colours that instances show now, recolours included; adjustments add up."""

    kind: ClassVar[str] = "adjust_instances"
    ids: tuple[int, ...]
    what: AdjustKind
    amount: float
    """Degrees for `hue` (-180 … 180), -1 … 1 for `temperature` (warm above 0), else a factor (0 … 4; opacity 0 … 1)."""

    def __post_init__(self) -> None:
        self.ids = checked_ids(self.ids)
        self.amount = checked_adjustment(self.what, self.amount)

    @property
    def title(self) -> str:
        """``Adjust hue of instance 17``."""
        return f"Adjust {self.what} of {ids_in_words(self.ids)}"

    def do(self, document: Document) -> bool:
        """Add the changed entries and point the instances' rows at them."""
        parts = [editable(document, (instance_id,)) for instance_id in self.ids]
        if self.amount == RANGES[self.what].neutral:
            return False
        return self.assign(document, [(rows, self._change(document, rows)) for rows in parts])

    def _change(self, document: Document, rows: ndarray) -> Callable[[ndarray], ndarray]:
        mean = shown_mean(document, rows) if self.what == "contrast" else np.zeros(3)
        matrix = adjustment(self.what, self.amount, mean)
        factor = self.amount if self.what == "opacity" else 1.0

        def change(values: ndarray) -> ndarray:
            before = values[:12].reshape(3, 4).astype(np.float64)
            after = matrix[:, :3] @ before
            after[:, 3] += matrix[:, 3]
            return color_values(after, float(values[12]) * factor)

        return change


def shown_mean(document: Document, rows: ndarray) -> Float64[ndarray, "3"]:
    """The mean of the rows' colours as they are shown now, without view dependence, weighted by opacity."""
    palette = document.colors
    return mean_color(document.scene.gaussians, rows, palette.matrices, palette.indices[rows])
