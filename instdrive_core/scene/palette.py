"""Colour edits without touching colours: each splat names a palette entry, an affine map of RGB and an opacity factor.

A splat's shown colour is max(A · c + b, 0), where c = 0.5 + Y0 · sh_dc + Σ Y_k · sh_rest_k is its colour before
clamping, and its opacity is alpha · sigmoid(opacity_logit). Both can be baked into the stored parameters exactly.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Int, UInt16
from numpy import ndarray

from instdrive_core.maths.activations import logit, sigmoid
from instdrive_core.maths.spherical_harmonics import color_from_dc, dc_from_color
from instdrive_core.scene.dirty_rows import DirtyRows
from instdrive_core.scene.gaussians import Gaussians

MAX_ENTRIES = 1 << 16


class PaletteFullError(ValueError):
    """More different recolours are alive than a 16-bit palette index can name."""


class ColorPalette:
    """Palette indices of N splats and the entries they name; entry 0 is the identity and is never removed.

    Entries are added and removed like a stack, so that undoing an edit restores the palette bit by bit.
    """

    def __init__(self, count: int) -> None:
        self._indices = np.zeros(count, np.uint16)
        self._matrices = np.eye(3, 4, dtype=np.float32)[None]
        self._alphas = np.ones(1, np.float32)
        self._keys = [_key(self._matrices[0], self._alphas[0])]
        self._entry_of = {self._keys[0]: 0}
        self._dirty = DirtyRows(count)
        self.version = 0
        """Rises with every change."""

    @property
    def indices(self) -> UInt16[ndarray, " n"]:
        """The palette entry of each splat, a read-only view."""
        return _read_only(self._indices)

    @property
    def matrices(self) -> Float32[ndarray, "p 3 4"]:
        """[A | b] of each entry, a read-only view."""
        return _read_only(self._matrices[: len(self._keys)])

    @property
    def alphas(self) -> Float32[ndarray, " p"]:
        """The opacity factor of each entry, a read-only view."""
        return _read_only(self._alphas[: len(self._keys)])

    def __len__(self) -> int:
        """The number of entries."""
        return len(self._keys)

    def add(self, matrix: Float32[ndarray, "3 4"], alpha: float = 1.0) -> int:
        """The index of an entry with these values: an equal one where there is one, else a new one.

        Raises PaletteFullError where all 65,536 entries are taken.
        """
        key = _key(matrix, np.float32(alpha))
        if key in self._entry_of:
            return self._entry_of[key]
        index = len(self._keys)
        if index == MAX_ENTRIES:
            raise PaletteFullError(f"the colour palette holds {MAX_ENTRIES} entries, no other fits")
        if index == len(self._matrices):
            self._matrices = np.concatenate([self._matrices, np.zeros_like(self._matrices)])
            self._alphas = np.concatenate([self._alphas, np.zeros_like(self._alphas)])
        self._matrices[index], self._alphas[index] = matrix, alpha
        self._keys.append(key)
        self._entry_of[key] = index
        self.version += 1
        return index

    def truncate(self, size: int) -> None:
        """Drop the entries from `size` on; no splat may still name one of them."""
        for key in self._keys[max(size, 1) :]:
            del self._entry_of[key]
            self.version += 1
        del self._keys[max(size, 1) :]

    def assign(self, rows: Int[ndarray, " m"], entries: UInt16[ndarray, " m"]) -> UInt16[ndarray, " m"]:
        """Name an entry for each row; returns the entries named before (the delta an edit stores)."""
        before = self._indices[rows]
        self._indices[rows] = entries
        if len(rows):
            self._touch(int(rows.min()), int(rows.max()) + 1)
        return before

    def append(self, count: int) -> None:
        """Add `count` splats in their own colours."""
        start = len(self._indices)
        self._indices = np.concatenate([self._indices, np.zeros(count, np.uint16)])
        self._touch(start, start + count)

    def take_dirty(self) -> tuple[int, int] | None:
        """The row range whose indices changed since the last call, or None."""
        return self._dirty.take()

    def _touch(self, start: int, stop: int) -> None:
        self.version += 1
        self._dirty.touch(start, stop)


def baked_colors(
    gaussians: Gaussians, palette: ColorPalette, rows: Int[ndarray, " m"]
) -> tuple[Float32[ndarray, "m 3"], Float32[ndarray, "m k 3"], Float32[ndarray, " m"]]:
    """sh_dc, sh_rest and opacity_logits of `rows` with their palette entries applied.

    dc' = (A (0.5 + Y0 dc) + b - 0.5) / Y0 and rest' = A rest, so the baked splat shows A c + b from everywhere.
    An opacity factor of 1 keeps the logit's bits.
    """
    entries = palette.indices[rows]
    linear, offset = palette.matrices[entries, :, :3], palette.matrices[entries, :, 3]
    colors = np.einsum("nij,nj->ni", linear, color_from_dc(gaussians.sh_dc[rows])) + offset
    rest = np.einsum("nij,nkj->nki", linear, gaussians.sh_rest[rows])
    logits, alphas = gaussians.opacity_logits[rows], palette.alphas[entries]
    logits = np.where(alphas == 1, logits, logit(alphas * sigmoid(logits)))
    return dc_from_color(colors).astype(np.float32), rest.astype(np.float32), logits.astype(np.float32)


def _key(matrix: ndarray, alpha: np.float32) -> bytes:
    return np.ascontiguousarray(matrix, np.float32).tobytes() + np.float32(alpha).tobytes()


def _read_only(array: ndarray) -> ndarray:
    view = array.view()
    view.flags.writeable = False
    return view
