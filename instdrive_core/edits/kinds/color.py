"""Recolouring instances through the colour palette, and back; a new recolour replaces the one before."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, Literal, get_args

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from instdrive_core.edits.bases.adjustments import LUMA, compute_hue, compute_hue_rotations, compute_hues
from instdrive_core.edits.bases.editable import find_colorable_parts, find_editable_rows
from instdrive_core.edits.bases.parameters import check_ids
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit, describe_ids
from instdrive_core.edits.document.entries import PartsChange, add_part_entries
from instdrive_core.edits.document.row_parts import RowParts
from instdrive_core.edits.queries.mean_colors import compute_mean_colors
from instdrive_core.errors import EditError
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.palette import DRAWN, pack_color_entries
from instdrive_core.wording import phrase

RecolorMode = Literal["tint", "hue", "solid"]
_TITLES: dict[RecolorMode, str] = {
    "tint": "Tint {objects} #{code}",
    "hue": "Shift hue of {objects} to #{code}",
    "solid": "Solid {objects} #{code}",
}
MEAN_LUMA_FLOOR = 0.05
"""Darker instances are not brightened by more than 20 times."""


@dataclass
class ColorEdit(Edit):
    """An edit of palette entries: subclasses say how entries change for which rows, this class does and undoes it."""

    _rows: ndarray | None = field(default=None, init=False, repr=False, compare=False)
    _before: ndarray | None = field(default=None, init=False, repr=False, compare=False)
    _size_before: int = field(default=1, init=False, repr=False, compare=False)

    def assign(self, document: Document, parts: RowParts, change: PartsChange) -> bool:
        """Add the changed entries of parts of rows, point the rows at them, remember; whether any row changed."""
        palette, size = document.colors, len(document.colors)
        wanted = add_part_entries(palette, parts, change)
        changed = palette.indices[parts.rows] != wanted
        self._rows, self._size_before = parts.rows[changed].astype(np.int32), size
        self._before = palette.assign(self._rows, wanted[changed])
        return len(self._rows) > 0

    def undo(self, document: Document) -> None:
        """Point the rows back and drop the entries this edit added."""
        assert self._rows is not None
        assert self._before is not None
        document.colors.assign(self._rows, self._before)
        document.colors.truncate(self._size_before)


@dataclass
class RecolorInstances(ColorEdit):
    """Give instances a colour.

    `tint` keeps light, shade and view dependence; `hue` turns the hues until the mean one is the colour's, so greys and
    differences of colour stay, too; `solid` is the colour from everywhere.
    What they were recoloured or adjusted to before is replaced; an opacity factor stays.
    """

    kind: ClassVar[str] = "recolor_instances"
    ids: tuple[int, ...]
    mode: RecolorMode
    color: tuple[float, float, float]
    """RGB in [0, 1]."""

    def __post_init__(self) -> None:
        self.ids = check_ids(self.ids)
        if self.mode not in get_args(RecolorMode):
            raise EditError(
                phrase(
                    "recolour mode {mode!r} is not one of {list}", mode=self.mode, list=", ".join(get_args(RecolorMode))
                )
            )
        if len(self.color) != 3 or not all(0 <= channel <= 1 for channel in self.color):
            raise EditError(phrase("colour {color!r} is not three numbers from 0 to 1", color=self.color))
        self.color = (float(self.color[0]), float(self.color[1]), float(self.color[2]))

    @property
    def title(self) -> str:
        """``Tint instance 17 #d02020``."""
        code = "".join(f"{round(channel * 255):02x}" for channel in self.color)
        objects = describe_ids(self.ids)
        return phrase(_TITLES[self.mode], objects=objects, code=code)

    def do(self, document: Document) -> bool:
        """Add one entry per instance and point the instance's rows at it."""
        parts = find_colorable_parts(document, self.ids)
        matrices = compute_recolor_matrices(document.scene.gaussians, parts, self.mode, self.color)
        return self.assign(
            document, parts, lambda values, part: pack_color_entries(matrices[part], values[:, DRAWN - 1])
        )


@dataclass
class ResetColors(ColorEdit):
    """Give instances the colours and opacities back that they were trained with."""

    kind: ClassVar[str] = "reset_colors"
    ids: tuple[int, ...]

    def __post_init__(self) -> None:
        self.ids = check_ids(self.ids)

    @property
    def title(self) -> str:
        """``Reset colours of instance 17``."""
        return phrase("Reset colours of {objects}", objects=describe_ids(self.ids))

    def do(self, document: Document) -> bool:
        """Point the instances' rows at the entry that changes nothing."""
        rows = RowParts.whole(find_editable_rows(document, self.ids))
        return self.assign(document, rows, lambda values, _: np.repeat(document.colors.values[:1], len(values), axis=0))


def compute_recolor_matrices(
    gaussians: Gaussians, parts: RowParts, mode: RecolorMode, color: tuple[float, float, float]
) -> Float32[ndarray, "k 3 4"]:
    """The palette entries [A | b] that recolour the Gaussians of instances, whose rows the parts are.

    `solid`: A = 0, b = colour. `tint`: A = colour ⊗ luma weights / mean luma, b = 0: the instance's mean
    (weighted by opacity) becomes the colour, and each Gaussian keeps its brightness relative to that mean.
    `hue`: A = the rotation from the mean's hue to the colour's.
    """
    matrices = np.zeros((len(parts), 3, 4))
    if mode == "solid":
        matrices[:, :, 3] = color
        return matrices.astype(np.float32)
    means = compute_mean_colors(gaussians, parts)
    if mode == "hue":
        matrices[:, :, :3] = compute_hue_rotations(compute_hue(color) - compute_hues(means))
    else:
        matrices[:, :, :3] = np.outer(color, LUMA) / np.maximum(means @ LUMA, MEAN_LUMA_FLOOR)[:, None, None]
    return matrices.astype(np.float32)
