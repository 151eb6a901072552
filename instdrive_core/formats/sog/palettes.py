"""Codebooks and palettes for SOG: few values that stand for many."""

from __future__ import annotations

import warnings

import numpy as np
from jaxtyping import Float32, Float64, Int64
from numpy import ndarray
from scipy.cluster.vq import kmeans2

from ...maths.streams import Stream, make_generator

CODES = 256
_ROUNDS = 20
_LEAF, _LEAF_ROUNDS = 32, 3
"""Entries of a palette that one k-means looks for, and its iterations."""


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
    different, place = np.unique(rows, axis=0, return_inverse=True)
    place = place.ravel().astype(np.int64)
    if len(different) <= most:
        return different, place
    palette, labels, used = [], np.empty(len(different), np.int64), 0
    parts = [(np.arange(len(different)), most)]
    rng = make_generator(0, Stream.SOG_PALETTE)
    while parts:
        mine, share = parts.pop()
        if share > _LEAF:
            column = different[mine][:, np.argmax(np.var(different[mine], axis=0))]
            order = mine[np.argsort(column, kind="stable")]
            parts += [(order[: len(mine) // 2], share // 2), (order[len(mine) // 2 :], share // 2)]
            continue
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
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # an empty cluster only leaves an entry unused
        centers, found = kmeans2(rows, starts, iter=_LEAF_ROUNDS, minit="matrix")
    used, found = np.unique(found, return_inverse=True)
    return centers[used].astype(np.float32), found.ravel().astype(np.int64)
