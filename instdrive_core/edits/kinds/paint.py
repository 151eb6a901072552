"""Painting the body of instances: only what is near the body's colour changes; glass, tyres and lights stay."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy import ndarray

from instdrive_core.edits.bases.adjustments import LUMA
from instdrive_core.edits.bases.body_color import RGB, find_body_colors, find_rows_near_colors
from instdrive_core.edits.bases.editable import find_colorable_parts
from instdrive_core.edits.bases.parameters import check_ids, check_number
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import describe_ids
from instdrive_core.edits.document.row_parts import RowParts
from instdrive_core.edits.kinds.color import MEAN_LUMA_FLOOR, ColorEdit
from instdrive_core.errors import EditError
from instdrive_core.scene.palette import DRAWN, pack_color_entries
from instdrive_core.wording import phrase

TOLERANCE = 0.18
"""Difference from the body's colour up to which splats are painted."""


@dataclass
class PaintInstances(ColorEdit):
    """Paint what is near a reference colour, with its light and shade; give the rest of the instances its own colours.

    What they were recoloured or adjusted to before is replaced; an opacity factor stays.
    """

    kind: ClassVar[str] = "paint_instances"
    ids: tuple[int, ...]
    color: RGB
    """RGB in [0, 1]."""
    tolerance: float = TOLERANCE
    """0: only what has the reference colour, 1: everything."""
    reference: RGB | None = None
    """RGB in [0, 1], as trained; None: the colour of most of each instance's surface."""

    def __post_init__(self) -> None:
        self.ids = check_ids(self.ids)
        self.color = _check_color(self.color, "color")
        self.tolerance = check_number(self.tolerance, "tolerance")
        if not 0 <= self.tolerance <= 1:
            raise EditError(phrase("tolerance {tolerance!r} is not from 0 to 1", tolerance=self.tolerance))
        if self.reference is not None:
            self.reference = _check_color(self.reference, "reference")

    @property
    def title(self) -> str:
        """``Paint instance 17 #d02020``."""
        return phrase(
            "Paint {objects} #{code}",
            objects=describe_ids(self.ids),
            code="".join(f"{round(channel * 255):02x}" for channel in self.color),
        )

    def do(self, document: Document) -> bool:
        """Add one entry per instance for what is painted, and point the rest at the trained colours."""
        gaussians, parts = document.scene.gaussians, find_colorable_parts(document, self.ids)
        if self.reference is None:
            references = find_body_colors(gaussians, parts)
        else:
            references = np.tile(np.array(self.reference, np.float64), (len(parts), 1))
        near = find_rows_near_colors(gaussians, parts, references, self.tolerance)
        painted = np.zeros((len(parts), 3, 4))
        brightness = np.maximum(references @ LUMA, MEAN_LUMA_FLOOR)
        painted[:, :, :3] = np.outer(self.color, LUMA) / brightness[:, None, None]
        body, rest = parts.filter(near), parts.filter(~near)
        rows = RowParts(
            np.concatenate([body.rows, rest.rows]), np.append(body.bounds, body.bounds[-1] + rest.bounds[1:])
        )
        matrices = np.concatenate([painted, np.tile(np.eye(3, 4), (len(parts), 1, 1))])
        stacked = matrices[rows.sizes > 0].astype(np.float32)
        rows = rows.drop_empty()

        def change(values: ndarray, part: ndarray) -> ndarray:
            return pack_color_entries(stacked[part], values[:, DRAWN - 1])

        return self.assign(document, rows, change)


def _check_color(values: object, name: str) -> RGB:
    if not isinstance(values, (list, tuple)) or len(values) != 3:
        raise EditError(phrase("{name} {values!r} is not three numbers from 0 to 1", name=name, values=values))
    red, green, blue = (check_number(value, name) for value in values)
    if not all(0 <= channel <= 1 for channel in (red, green, blue)):
        raise EditError(phrase("{name} {values!r} is not three numbers from 0 to 1", name=name, values=values))
    return red, green, blue
