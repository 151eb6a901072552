"""Colour edits without touching colours: each splat names a palette entry, an affine map of RGB and an opacity factor.

A splat's shown colour is max(A · c + b, 0), where c = 0.5 + Y0 · sh_dc + Σ Y_k · sh_rest_k is its colour before
clamping, and its opacity is alpha · sigmoid(opacity_logit). Both can be baked into the stored parameters exactly.

Beside what is drawn an entry remembers how it came about: the map before any adjustment, and how far each adjustment is
from neutral. So a slider finds its place again after undo, in a duplicate, and in every piece of a split instance.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float32, Int
from numpy import ndarray

from instdrive_core.maths.activations import logit, sigmoid
from instdrive_core.maths.spherical_harmonics import color_from_dc, dc_from_color
from instdrive_core.scene.entry_palette import MAX_ENTRIES, EntryPalette, PaletteFullError
from instdrive_core.scene.gaussians import Gaussians

__all__ = ["MAX_ENTRIES", "ColorPalette", "PaletteFullError", "bake_colors", "pack_color_entries", "pack_color_entry"]

DRAWN = 13
"""Numbers of an entry that are drawn: [A | b] row by row, then the opacity factor."""
ADJUSTMENTS = 5
"""Adjustments that an entry remembers; which they are, and what their amounts mean, is the edits' matter."""


class ColorPalette(EntryPalette):
    """Colour changes [A | b] and opacity factors, float32, and what they were made of; entry 0 changes nothing."""

    name = "colour palette"

    def __init__(self, count: int) -> None:
        super().__init__(count, pack_color_entry(np.eye(3, 4, dtype=np.float32), 1.0))

    @property
    def matrices(self) -> Float32[ndarray, "p 3 4"]:
        """[A | b] of each entry, a read-only view."""
        return self.values[:, :12].reshape(-1, 3, 4)

    @property
    def alphas(self) -> Float32[ndarray, " p"]:
        """The opacity factor of each entry, a read-only view."""
        return self.values[:, DRAWN - 1]

    @property
    def bases(self) -> Float32[ndarray, "p 3 4"]:
        """[A | b] of each entry as it was before any adjustment, a read-only view."""
        return self.values[:, DRAWN : DRAWN + 12].reshape(-1, 3, 4)

    @property
    def adjusted(self) -> Float32[ndarray, "p a"]:
        """How far each adjustment of each entry is from neutral, a read-only view."""
        return self.values[:, DRAWN + 12 :]

    def add(self, matrix: Float32[ndarray, "3 4"], alpha: float = 1.0) -> int:
        """The index of an entry with these values: an equal one where there is one, else a new one.

        Raises PaletteFullError where all 65,536 entries are taken.
        """
        return self.add_values(pack_color_entry(matrix, alpha))


def pack_color_entry(
    matrix: Float[ndarray, "3 4"],
    alpha: float,
    base: Float[ndarray, "3 4"] | None = None,
    adjusted: Float[ndarray, " a"] | None = None,
) -> Float32[ndarray, " w"]:
    """Pack an entry as it is stored: [A | b] row by row, the opacity factor, the base, the adjustments.

    Without `base` and `adjusted` the colours count as not adjusted: the base is the matrix itself.
    """
    one = None if base is None else base[None]
    return pack_color_entries(matrix[None], np.array([alpha]), one, None if adjusted is None else adjusted[None])[0]


def pack_color_entries(
    matrices: Float[ndarray, "k 3 4"],
    alphas: Float[ndarray, " k"],
    bases: Float[ndarray, "k 3 4"] | None = None,
    adjusted: Float[ndarray, "k a"] | None = None,
) -> Float32[ndarray, "k w"]:
    """Pack k entries as `pack_color_entry` packs one."""
    count = len(matrices)
    bases = matrices if bases is None else bases
    adjusted = np.zeros((count, ADJUSTMENTS)) if adjusted is None else adjusted
    parts = [matrices.reshape(count, -1), alphas[:, None], bases.reshape(count, -1), adjusted]
    return np.concatenate(parts, axis=1).astype(np.float32)


def bake_colors(
    gaussians: Gaussians, palette: ColorPalette, rows: Int[ndarray, " m"]
) -> tuple[Float32[ndarray, "m 3"], Float32[ndarray, "m k 3"], Float32[ndarray, " m"]]:
    """Compute sh_dc, sh_rest and opacity_logits of `rows` with their palette entries applied.

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
