"""Codebooks and palettes for SOG: few values that stand for many."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Float64, Int64
from numpy import ndarray

from instdrive_core.formats.sog.clusters import cluster_rows, find_different_rows, split_rows
from instdrive_core.maths.streams import Stream, make_generator

CODES = 256
_ROUNDS = 20
_LEAF = 32
"""Entries of a palette that one k-means looks for."""


def choose_codebook(values: Float32[ndarray, " n"]) -> Float64[ndarray, "256"]:
    """Choose 256 rising values near which all others lie: Lloyd's method in one dimension, from quantiles.

    The least and the greatest value are among them, so that no value is cut off.
    """
    ordered = np.sort(values.astype(np.float64))
    sums = np.concatenate([[0.0], np.cumsum(ordered)])
    codes = np.interp(np.linspace(0, 1, CODES), np.linspace(0, 1, len(ordered)), ordered)
    # Quantiles serve the crowd, even steps the rest.
    codes = np.sort(np.concatenate([codes[::2], np.linspace(ordered[0], ordered[-1], CODES // 2)]))
    for _ in range(_ROUNDS):
        edges = np.concatenate([[0], np.searchsorted(ordered, (codes[1:] + codes[:-1]) / 2), [len(ordered)]])
        counts = np.diff(edges)
        codes = np.sort(np.where(counts > 0, np.diff(sums[edges]) / np.maximum(counts, 1), codes))
        codes[0], codes[-1] = ordered[0], ordered[-1]
    return np.clip(codes, ordered[0], ordered[-1])


def find_codes(values: ndarray, codes: Float64[ndarray, "256"]) -> ndarray:
    """Find the nearest value of a rising codebook; returns bytes in the shape of `values`."""
    return np.searchsorted((codes[1:] + codes[:-1]) / 2, values).astype(np.uint8)


def choose_palette(rows: Float32[ndarray, "n d"], most: int) -> tuple[Float32[ndarray, "p d"], Int64[ndarray, " n"]]:
    """Choose at most `most` rows that stand for all, and which one stands for each.

    Up to `most` different rows stand for themselves. More are split at the median of the column that varies most until
    each part is small, and k-means finds the entries of a part: the same rows give the same palette.
    """
    if len(rows) <= most:
        return rows, np.arange(len(rows))
    first, place = find_different_rows(np.ascontiguousarray(rows))
    different = rows[first]
    if len(different) <= most:
        return different, place
    order, parts = split_rows(different, most, _LEAF)
    share = most // len(parts)
    palette, labels, used = [], np.empty(len(different), np.int64), 0
    rng = make_generator(0, Stream.SOG_PALETTE)
    for part in parts:
        mine = order[part.start : part.stop]
        centers, found = _cluster(different[mine], share, rng)
        palette.append(centers)
        labels[mine] = found + used
        used += len(centers)
    return np.concatenate(palette), labels[place]


def _cluster(
    rows: Float32[ndarray, "n d"], count: int, rng: np.random.Generator
) -> tuple[Float32[ndarray, "c d"], Int64[ndarray, " n"]]:
    """Means of at most `count` clusters, none empty, and the cluster of each row."""
    if len(rows) <= count:
        return rows, np.arange(len(rows))
    starts = rows[np.sort(rng.choice(len(rows), count, replace=False))]
    centers, found = cluster_rows(rows, starts)
    used, found = np.unique(found, return_inverse=True)
    return centers[used], found.ravel().astype(np.int64)
