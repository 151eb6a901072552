"""Feet of poles and trunks behind a deleted thing, of which photos showed only what is above the thing.

They are continued down to the ground by copies of their lowest piece that photos showed. People, bins and bushes are
not: nobody knows from a torso what legs look like.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray

from instdrive_core.edits.holes.photo_evidence import Look
from instdrive_core.edits.holes.surroundings import Neighborhood
from instdrive_core.edits.queries.placement import SOLID_OPACITY
from instdrive_core.maths.cells import connect_cells

LAYER = 0.1
"""Metres per layer in which splats are counted."""
LEAST_SHARE = 0.5
"""Share of the splats of the layers above it that the lowest layer must have …"""
LAYERS_ABOVE = 8
"""… of so many of them: what photos never showed is thin, and spread out."""
PIECE = 0.4
"""Metres of height that are copied."""
MAX_TAPER = 1.5
"""Factor by which the piece above that one may be narrower or wider."""
MIN_SLENDER = 2.0
"""Times as high as wide that what is continued must be."""
MIN_SPLATS = 8
"""Solid splats of a piece."""
MAX_WIDTH = 0.8
"""Metres: what is wider is a wall, a crown or a vehicle."""
GAPS = (0.25, 2.0)
"""Metres above the ground at which something hangs that would stand there. Cars hide no more, and the plates of signs
hang higher."""
HIDDEN_SHARE = 0.7
"""Share of the way down to the ground that photos must show within the deleted thing's silhouette."""
BESIDE = 0.2
"""Metres beside a piece within which something else carries it …"""
BESIDE_SHARE = 0.3
"""… if that has so many splats there for each of the piece's."""
SUPPORT_SHARE = 0.5
"""Share of the height below a piece in which something else must be for the piece to stand on it."""
RAGGED = 0.3
"""Metres around a piece within which splats of its instance below it are what photos never showed."""
HIGHEST = 3.0
"""Metres above the ground up to which is looked: above, crowns and cables join what stands apart."""
APART = 0.2
"""Metres per side of the cells in the plane, of which one must be free between two parts."""
_STEPS = 8
_TRIM = 0.05


@dataclass(frozen=True)
class Continuation:
    """How one upright thing goes on down to the ground."""

    copied: Int64[ndarray, " c"]
    """Rows of the document, each as often as it is copied."""
    drops: Float64[ndarray, " c"]
    """Metres by which each copy is lower."""
    replaced: Int64[ndarray, " r"]
    """Rows of the document below the piece, which the copies replace."""


@dataclass(frozen=True)
class _Piece:
    """The lowest piece that photos showed of something narrow; places count in the neighbourhood."""

    rows: Int64[ndarray, " p"]
    bottom: float
    """Height of its lower end in the world, metres."""
    middle: Float64[ndarray, "2"]
    half: Float64[ndarray, "2"]


def continue_uprights(
    near: Neighborhood, looks: Sequence[Look], find_levels: Callable[[Float64[ndarray, "k 2"]], Float64[ndarray, " k"]]
) -> tuple[Continuation, ...]:
    """Continue what hangs behind a deleted thing, which the `looks` show, down to the ground; nothing that is locked.

    `near` are the splats that stay, `find_levels` gives the ground's height (metres in the world) at x and y.
    """
    low = np.flatnonzero(near.means[:, 2] - find_levels(near.means[:, :2].astype(np.float64)) < HIGHEST)
    found = []
    for members in _list_parts(near, low[(near.instance_ids[low] > 0) & ~near.locked[low]]):
        piece = _find_lowest_piece(near, members)
        if piece is None or _is_carried(near, members, piece):
            continue
        level = float(find_levels(piece.middle[None])[0])
        hangs = GAPS[0] <= piece.bottom - level <= GAPS[1] and not _is_supported(near, piece, level)
        if hangs and _is_hidden(piece, level, looks):
            found.append(_continue(near, members, piece, level))
    return tuple(found)


def _list_parts(near: Neighborhood, rows: Int64[ndarray, " k"]) -> Iterator[Int64[ndarray, " m"]]:
    """The rows, instance by instance, in parts that are apart in the plane: poles of one label may be many."""
    for number in np.unique(near.instance_ids[rows]).tolist():
        members = rows[near.instance_ids[rows] == number]
        if len(members) < MIN_SPLATS:
            continue
        places = np.floor(near.means[members, :2] / APART).astype(np.int64)
        cells, cell_of = np.unique(places, axis=0, return_inverse=True)
        part_of = connect_cells(np.c_[cells, np.zeros(len(cells), np.int64)])[cell_of.ravel()]
        for part in range(int(part_of.max()) + 1):
            yield members[part_of == part]


def _find_lowest_piece(near: Neighborhood, members: Int64[ndarray, " m"]) -> _Piece | None:
    """The lowest piece of an instance above what is thin; None where that is no pole and no trunk: as wide as the piece
    above it, and not wider than `MAX_WIDTH`."""
    solid = members[near.opacities[members] >= SOLID_OPACITY]
    heights = near.means[solid, 2].astype(np.float64)
    if len(solid) < MIN_SPLATS:
        return None
    layers = np.floor((heights - heights.min()) / LAYER).astype(np.int64)
    counts = np.bincount(layers)
    layer = next((layer for layer in range(len(counts)) if _is_dense(counts, layer)), None)
    if layer is None:
        return None
    bottom = float(heights.min() + LAYER * layer)
    piece, above = (solid[(heights >= low) & (heights < low + PIECE)] for low in (bottom, bottom + PIECE))
    if len(piece) < MIN_SPLATS or len(above) < LEAST_SHARE * len(piece):
        return None
    (low, high), (low_above, high_above) = (_measure_outline(near, rows) for rows in (piece, above))
    width, width_above = (high - low).max(), (high_above - low_above).max()
    if float(heights.max()) - bottom < MIN_SLENDER * width:
        return None
    if width > MAX_WIDTH or max(width, width_above) > MAX_TAPER * min(width, width_above) + BESIDE / 2:
        return None
    return _Piece(piece, bottom, (low + high) / 2, (high - low) / 2)


def _measure_outline(near: Neighborhood, rows: Int64[ndarray, " k"]) -> Float64[ndarray, "2 2"]:
    """Smallest and largest x and y, strays left out."""
    return np.quantile(near.means[rows, :2].astype(np.float64), [_TRIM, 1 - _TRIM], axis=0)


def _is_dense(counts: Int64[ndarray, " l"], layer: int) -> bool:
    above = counts[layer + 1 : layer + 1 + LAYERS_ABOVE]
    return bool(above.any() and counts[layer] and counts[layer] >= LEAST_SHARE * np.median(above[above > 0]))


def _is_carried(near: Neighborhood, members: Int64[ndarray, " m"], piece: _Piece) -> bool:
    """Whether something else stands right beside it, such as the wall that it is mounted on."""
    offsets = np.abs(near.means[:, :2] - piece.middle) <= piece.half + BESIDE
    heights = near.means[:, 2] - piece.bottom
    beside = offsets.all(axis=1) & (heights >= 0) & (heights < PIECE) & (near.opacities >= SOLID_OPACITY)
    beside[members] = False
    return bool(np.count_nonzero(beside) > BESIDE_SHARE * len(piece.rows))


def _is_supported(near: Neighborhood, piece: _Piece, level: float) -> bool:
    """Whether something else stands below it already, such as a plinth, or what the fill of another hole has laid."""
    below = (np.abs(near.means[:, :2] - piece.middle) <= piece.half + LAYER / 2).all(axis=1)
    below &= (near.means[:, 2] > level + LAYER) & (near.means[:, 2] < piece.bottom) & (near.opacities >= SOLID_OPACITY)
    below &= near.instance_ids != near.instance_ids[piece.rows[0]]
    layers = np.unique(np.floor((near.means[below, 2] - level) / LAYER))
    return bool(len(layers) * LAYER >= SUPPORT_SHARE * (piece.bottom - level - LAYER))


def _is_hidden(piece: _Piece, level: float, looks: Sequence[Look]) -> bool:
    """Whether the deleted thing stood before the way from the piece down to the ground."""
    heights = np.linspace(piece.bottom, level, _STEPS + 2)[1:-1]
    points = np.c_[np.tile(piece.middle, (_STEPS, 1)), heights]
    hidden = np.zeros(_STEPS, bool)
    for look in looks:
        pixels, depths = look.camera.project(points)
        height, width = look.silhouette.shape
        columns, lines = np.floor(np.where(depths[:, None] > look.nearest, pixels, -1)).T
        inside = (columns >= 0) & (columns < width) & (lines >= 0) & (lines < height)
        hidden[inside] |= look.silhouette[lines[inside].astype(np.int64), columns[inside].astype(np.int64)]
    return bool(hidden.mean() >= HIDDEN_SHARE)


def _continue(near: Neighborhood, members: Int64[ndarray, " m"], piece: _Piece, level: float) -> Continuation:
    close = (np.abs(near.means[:, :2] - piece.middle) <= piece.half + RAGGED).all(axis=1)
    heights = near.means[:, 2].astype(np.float64) - piece.bottom
    source = members[(close & (heights >= 0) & (heights < PIECE))[members]]
    count = int(np.ceil((piece.bottom - level) / PIECE))
    copied, drops = np.tile(source, count), np.repeat(PIECE * np.arange(1, count + 1), len(source))
    stays = heights[copied] - drops > level - piece.bottom
    ragged = close & (heights < 0) & (near.instance_ids == near.instance_ids[piece.rows[0]])
    return Continuation(near.rows[copied[stays]], drops[stays], near.rows[ragged])
