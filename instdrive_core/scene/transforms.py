"""Moves without touching splats: each splat names a palette entry, a rotation with uniform scale and translation.

A splat at x, in its node's own frame, is drawn at s R x + t, turned by R and s times as large, and its view-dependent
colour turns with it. All of it can be baked into the stored parameters.

Beside what is drawn an entry remembers its home: where the splat belongs when it is not moved by itself. That is where
the file has it, or where the whole scene was turned to since.
"""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int, UInt16
from numpy import ndarray

from instdrive_core.maths.rotations import multiply_quaternions, normalize_quaternions, quaternion_from_matrix
from instdrive_core.maths.sh_rotation import rotate_rest
from instdrive_core.scene.entry_palette import EntryPalette
from instdrive_core.scene.gaussians import Gaussians

_BLOCK_ROWS = 1 << 16
"""Rows transformed at a time, so that the temporary arrays stay small."""
Similarity = Float64[ndarray, "3 4"]
"""[s R | t]."""


EntryChange = Callable[[Float64[ndarray, "24"]], Float64[ndarray, "24"]]
"""Change of an entry as it is stored."""


class TransformPalette(EntryPalette):
    """A similarity per entry and the home that it was moved from, float64; entry 0 moves nothing."""

    name = "transform palette"

    def __init__(self, count: int) -> None:
        super().__init__(count, np.tile(np.eye(3, 4).reshape(-1), 2))

    @property
    def matrices(self) -> Float64[ndarray, "p 3 4"]:
        """[s R | t] of each entry, a read-only view."""
        return self.values[:, :12].reshape(-1, 3, 4)

    @property
    def homes(self) -> Float64[ndarray, "p 3 4"]:
        """[s R | t] of each entry's home, a read-only view."""
        return self.values[:, 12:].reshape(-1, 3, 4)

    def get_move(self, entry: int) -> Similarity:
        """Compute [s R | t] from an entry's home to where it moves things."""
        matrix, home = self.matrices[entry], self.homes[entry]
        return matrix if np.array_equal(home, np.eye(3, 4)) else compose_transforms(matrix, invert_transform(home))

    def find_entry_at_home(self, home: Similarity) -> int:
        """Find the entry of what is at this home; 0 where there is none."""
        same = (self.matrices == home).all(axis=(1, 2)) & (self.homes == home).all(axis=(1, 2))
        return int(same.argmax())

    def add(self, matrix: Similarity) -> int:
        """Find or add the entry of a move from where the file has things. Raises PaletteFullError."""
        return self.add_values(np.concatenate([matrix.reshape(-1), np.eye(3, 4).reshape(-1)]))


def move_entry(matrix: Similarity) -> EntryChange:
    """Create the change that adds a move to what an entry does; its home stays."""
    return lambda values: np.concatenate([_compose_part(matrix, values[:12]), values[12:]])


def rebase_entry(matrix: Similarity) -> EntryChange:
    """Create the change that moves an entry and its home together: what was moved keeps its way back."""
    return lambda values: np.concatenate([_compose_part(matrix, part) for part in (values[:12], values[12:])])


def reset_entry(values: Float64[ndarray, "24"]) -> Float64[ndarray, "24"]:
    """Change an entry to that of what is at home."""
    return np.tile(values[12:], 2)


def _compose_part(matrix: Similarity, part: Float64[ndarray, "12"]) -> Float64[ndarray, "12"]:
    return compose_transforms(matrix, part.reshape(3, 4)).reshape(-1)


def compose_transforms(outer: Similarity, inner: Similarity) -> Similarity:
    """Compose two similarities: first `inner`, then `outer`."""
    result = outer[:, :3] @ inner
    result[:, 3] += outer[:, 3]
    return result


def invert_transform(matrix: Similarity) -> Similarity:
    """Invert a similarity."""
    linear = matrix[:, :3].T / (matrix[:, 0] @ matrix[:, 0])
    return np.c_[linear, -linear @ matrix[:, 3]]


def extract_scale(matrix: Float[ndarray, "3 4"]) -> float:
    """Extract the uniform scale s of [s R | t]."""
    return float(np.linalg.norm(matrix[:, 0]))


def compute_current_means(
    gaussians: Gaussians, palette: TransformPalette, rows: Int[ndarray, " m"] | None = None
) -> Float32[ndarray, "m 3"]:
    """Compute the means of `rows` (all by default) with their moves applied, in their nodes' frames; read only."""
    means, entries = gaussians.means, palette.indices
    if rows is not None:
        means, entries = means[rows], entries[rows]
    if not entries.any():
        return means
    inputs = (np.ascontiguousarray(array) for array in (means, entries, palette.matrices))
    return _move_means(*inputs)


@numba.njit(cache=True, error_model="numpy")
def _move_means(
    means: Float32[ndarray, "n 3"], entries: UInt16[ndarray, " n"], matrices: Float64[ndarray, "p 3 4"]
) -> Float32[ndarray, "n 3"]:
    """Move each mean by the matrix that its row names; those with entry 0 stay bit by bit."""
    result = means.copy()
    for row in range(len(means)):
        entry = entries[row]
        if entry:
            x, y, z = means[row, 0], means[row, 1], means[row, 2]
            for axis in range(3):
                matrix = matrices[entry, axis]
                result[row, axis] = matrix[0] * x + matrix[1] * y + matrix[2] * z + matrix[3]
    return result


def copy_transformed(gaussians: Gaussians, palette: TransformPalette, rows: Int[ndarray, " m"]) -> Gaussians:
    """Copy `rows` with their moves applied: what is drawn of them, in their nodes' frames."""
    part = gaussians.select(rows)
    bake_transforms(part, palette, palette.indices[rows])
    return part


def copy_at_home(gaussians: Gaussians, palette: TransformPalette, rows: Int[ndarray, " m"]) -> Gaussians:
    """Copy `rows` as they were before they were moved by themselves, in their nodes' frames."""
    part = gaussians.select(rows)
    _bake(part, palette.homes, palette.indices[rows])
    return part


def copy_shapes_at_home(gaussians: Gaussians, palette: TransformPalette) -> Gaussians:
    """Copy all Gaussians without view-dependent colour and features as they were before they were moved by themselves,
    in their nodes' frames. Arrays in which nothing differs are not copied: read only."""
    count, arrays = len(gaussians), gaussians.arrays()
    arrays |= {"sh_rest": np.zeros((count, 0, 3), np.float32), "features": np.zeros((count, 0), np.float32)}
    if (palette.homes == np.eye(3, 4)).all():
        return Gaussians(**arrays)
    arrays |= {name: arrays[name].copy() for name in ("means", "quats", "log_scales")}
    part = Gaussians(**arrays)
    _bake(part, palette.homes, palette.indices)
    return part


def find_away(palette: TransformPalette, rows: Int[ndarray, " m"]) -> Bool[ndarray, " m"]:
    """Find which rows were moved, turned or scaled by themselves and not put back."""
    return (palette.matrices != palette.homes).any(axis=(1, 2))[palette.indices[rows]]


def bake_transforms(gaussians: Gaussians, palette: TransformPalette, entries: UInt16[ndarray, " n"]) -> None:
    """Bake moves: write means, quaternions, scales and SH rest of all rows whose entry is not 0. `entries` (n,)."""
    _bake(gaussians, palette.matrices, entries)


def _bake(gaussians: Gaussians, matrices: Float64[ndarray, "p 3 4"], entries: UInt16[ndarray, " n"]) -> None:
    moved = np.flatnonzero(entries)
    if not len(moved):
        return
    order = moved[np.argsort(entries[moved], kind="stable")]
    named, starts = np.unique(entries[order], return_index=True)
    for entry, rows in zip(named.tolist(), np.split(order, starts[1:]), strict=True):
        matrix = matrices[entry]
        scale = extract_scale(matrix)
        rotation = matrix[:, :3] / scale
        gaussians.means[rows] = gaussians.means[rows] @ matrix[:, :3].T + matrix[:, 3]
        gaussians.log_scales[rows] += np.float32(np.log(scale))
        if not np.array_equal(rotation, np.eye(3)):
            turns = np.broadcast_to(quaternion_from_matrix(rotation), (len(rows), 4))
            gaussians.quats[rows] = multiply_quaternions(turns, normalize_quaternions(gaussians.quats[rows]))
            gaussians.sh_rest[rows] = rotate_rest(gaussians.sh_rest[rows], rotation)


def transform_gaussians(gaussians: Gaussians, matrix: Similarity) -> None:
    """Turn, scale and shift Gaussians by [s R | t], in place and block by block."""
    scale = extract_scale(matrix)
    rotation = matrix[:, :3] / scale
    turn = quaternion_from_matrix(rotation)
    is_turned = not np.array_equal(rotation, np.eye(3))
    with np.errstate(over="ignore", invalid="ignore"):  # the linter reports what is not finite
        for start in range(0, len(gaussians), _BLOCK_ROWS):
            rows = slice(start, start + _BLOCK_ROWS)
            gaussians.means[rows] = gaussians.means[rows] @ matrix[:, :3].T + matrix[:, 3]
            gaussians.log_scales[rows] += np.float32(np.log(scale))
            if is_turned:
                quats = normalize_quaternions(gaussians.quats[rows])
                gaussians.quats[rows] = multiply_quaternions(np.broadcast_to(turn, quats.shape), quats)
                gaussians.sh_rest[rows] = rotate_rest(gaussians.sh_rest[rows], rotation)
