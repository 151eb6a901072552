"""Recolouring instances through the colour palette, and back; a new recolour replaces the one before."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Literal, get_args

import numpy as np
from jaxtyping import Float, Float32, Float64
from numpy import ndarray

from instdrive_core.edits.adjustments import LUMA, hue_of, hue_rotation
from instdrive_core.edits.base import Edit, ids_in_words
from instdrive_core.edits.delete import editable
from instdrive_core.edits.document import Document
from instdrive_core.edits.entries import RowsChange, changed_entries
from instdrive_core.edits.parameters import checked_ids
from instdrive_core.errors import EditError
from instdrive_core.maths.activations import sigmoid
from instdrive_core.maths.spherical_harmonics import color_from_dc
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.palette import color_values

RecolorMode = Literal["tint", "hue", "solid"]
IDENTITY = np.eye(3, 4, dtype=np.float32)[None]
MEAN_LUMA_FLOOR = 0.05
"""Darker instances are not brightened by more than 20 times."""


@dataclass
class ColorEdit(Edit):
    """An edit of palette entries: subclasses say how entries change for which rows, this class does and undoes it."""

    _rows: ndarray | None = field(default=None, init=False, repr=False, compare=False)
    _before: ndarray | None = field(default=None, init=False, repr=False, compare=False)
    _size_before: int = field(default=1, init=False, repr=False, compare=False)

    def assign(self, document: Document, parts: Sequence[RowsChange]) -> bool:
        """For rows and a change of entry values each: add the changed entries, point the rows at them, remember."""
        palette, size = document.colors, len(document.colors)
        wanted = changed_entries(palette, parts)
        rows = np.concatenate([part for part, _ in parts])
        changed = palette.indices[rows] != wanted
        self._rows, self._size_before = rows[changed].astype(np.int32), size
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
        self.ids = checked_ids(self.ids)
        if self.mode not in get_args(RecolorMode):
            raise EditError(f"recolour mode {self.mode!r} is not one of {', '.join(get_args(RecolorMode))}")
        if len(self.color) != 3 or not all(0 <= channel <= 1 for channel in self.color):
            raise EditError(f"colour {self.color!r} is not three numbers from 0 to 1")
        self.color = (float(self.color[0]), float(self.color[1]), float(self.color[2]))

    @property
    def title(self) -> str:
        """``Tint instance 17 #d02020``."""
        code = "".join(f"{round(channel * 255):02x}" for channel in self.color)
        if self.mode == "hue":
            return f"Shift hue of {ids_in_words(self.ids)} to #{code}"
        return f"{self.mode.capitalize()} {ids_in_words(self.ids)} #{code}"

    def do(self, document: Document) -> bool:
        """Add one entry per instance and point the instance's rows at it."""
        parts = [editable(document, (instance_id,)) for instance_id in self.ids]
        matrices = [recolor_matrix(document.scene.gaussians, rows, self.mode, self.color) for rows in parts]
        return self.assign(document, [(rows, _replacing(matrix)) for rows, matrix in zip(parts, matrices, strict=True)])


@dataclass
class ResetColors(ColorEdit):
    """Give instances the colours and opacities back that they were trained with."""

    kind: ClassVar[str] = "reset_colors"
    ids: tuple[int, ...]

    def __post_init__(self) -> None:
        self.ids = checked_ids(self.ids)

    @property
    def title(self) -> str:
        """``Reset colours of instance 17``."""
        return f"Reset colours of {ids_in_words(self.ids)}"

    def do(self, document: Document) -> bool:
        """Point the instances' rows at the entry that changes nothing."""
        return self.assign(document, [(editable(document, self.ids), lambda _: document.colors.values[0])])


def _replacing(matrix: Float32[ndarray, "3 4"]) -> Callable[[ndarray], ndarray]:
    return lambda values: color_values(matrix, float(values[12]))


def recolor_matrix(
    gaussians: Gaussians, rows: ndarray, mode: RecolorMode, color: tuple[float, float, float]
) -> Float32[ndarray, "3 4"]:
    """The palette entry [A | b] that recolours the Gaussians of one instance.

    `solid`: A = 0, b = colour. `tint`: A = colour ⊗ luma weights / mean luma, b = 0: the instance's mean
    (weighted by opacity) becomes the colour, and each Gaussian keeps its brightness relative to that mean.
    `hue`: A = the rotation from the mean's hue to the colour's.
    """
    matrix = np.zeros((3, 4))
    if mode == "solid":
        matrix[:, 3] = color
        return matrix.astype(np.float32)
    mean = mean_color(gaussians, rows)
    if mode == "hue":
        matrix[:, :3] = hue_rotation(hue_of(color) - hue_of(mean))
    else:
        matrix[:, :3] = np.outer(color, LUMA) / max(float(LUMA @ mean), MEAN_LUMA_FLOOR)
    return matrix.astype(np.float32)


def mean_color(
    gaussians: Gaussians, rows: ndarray, maps: Float[ndarray, "p 3 4"] = IDENTITY, entries: ndarray | None = None
) -> Float64[ndarray, "3"]:
    """The mean colour of rows, without view dependence and not below black, weighted by opacity.

    `entries` (m,) say which of the `maps` [A | b] each row's colour goes through first; without them it is the first.
    """
    colors = color_from_dc(gaussians.sh_dc[rows]).astype(np.float64)
    weights = sigmoid(gaussians.opacity_logits[rows]).astype(np.float64)
    named = [0] if entries is None else np.flatnonzero(np.bincount(entries)).tolist()
    total = np.zeros(3)
    for entry in named:
        chosen = slice(None) if len(named) == 1 else np.flatnonzero(entries == entry)
        matrix = maps[entry].astype(np.float64)
        total += weights[chosen] @ np.maximum(colors[chosen] @ matrix[:, :3].T + matrix[:, 3], 0)
    return total / max(float(weights.sum()), 1e-12)
