"""Clusters of many rows, in parts: what the palettes of `palettes` are made of."""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float32, Int64
from numpy import ndarray

ROUNDS = 3
"""Iterations of a k-means."""
_MULTIPLIER = np.uint64(0x9E3779B97F4A7C15)


def find_different_rows(rows: Float32[ndarray, "n d"]) -> tuple[Int64[ndarray, " m"], Int64[ndarray, " n"]]:
    """Find the first of each kind of equal rows, and which of these each row equals.

    Rows are told apart by a hash of their bits, compared afterwards. Where two kinds share a hash, they are sorted
    instead, which takes ten times as long.
    """
    _, first, place = np.unique(_hash_rows(rows.view(np.uint32)), return_index=True, return_inverse=True)
    if not _equal_rows(rows, first, place):
        _, first, place = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return first.astype(np.int64), place.ravel().astype(np.int64)


def split_rows(rows: Float32[ndarray, "n d"], count: int, most: int) -> tuple[Int64[ndarray, " n"], list[range]]:
    """Halve rows at the median of the column that varies most, again and again.

    Args:
        rows: the rows.
        count: what is shared among the parts, half of it to each half.
        most: parts whose share is no larger are not split.

    Returns the rows' numbers in an order in which the parts lie one after the other, and the parts as ranges of it.
    """
    order, pending, parts = np.arange(len(rows)), [(range(len(rows)), count)], []
    while pending:
        part, share = pending.pop()
        if share <= most:
            parts.append(part)
            continue
        mine = order[part.start : part.stop]
        column = rows[mine, _find_widest_column(rows, mine)]
        half = len(mine) // 2
        order[part.start : part.stop] = mine[np.argpartition(column, half)]
        middle = part.start + half
        pending += [(range(part.start, middle), share // 2), (range(middle, part.stop), share - share // 2)]
    return order, parts


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz"})
def cluster_rows(rows, starts):
    """Move `starts` (k, d) to the means of the rows (n, d) nearest to each; a mean without rows stays.

    Returns (k, d) float32 and each row's nearest one, (n,) int64.
    """
    count, width = rows.shape
    kinds = len(starts)
    centers = starts.copy()
    found = np.zeros(count, np.int64)
    lengths = np.empty(kinds, np.float32)
    for turn in range(ROUNDS + 1):
        for kind in range(kinds):
            length = np.float32(0)
            for column in range(width):
                length += centers[kind, column] * centers[kind, column]
            lengths[kind] = length
        for row in range(count):
            best = np.float32(np.inf)
            for kind in range(kinds):
                product = np.float32(0)
                for column in range(width):
                    product += rows[row, column] * centers[kind, column]
                apart = lengths[kind] - np.float32(2) * product
                if apart < best:
                    best = apart
                    found[row] = kind
        if turn == ROUNDS:
            break
        sums = np.zeros((kinds, width), np.float64)
        members = np.zeros(kinds, np.int64)
        for row in range(count):
            kind = found[row]
            members[kind] += 1
            for column in range(width):
                sums[kind, column] += rows[row, column]
        for kind in range(kinds):
            if members[kind]:
                for column in range(width):
                    centers[kind, column] = sums[kind, column] / members[kind]
    return centers, found


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _hash_rows(bits):
    count, width = bits.shape
    hashes = np.empty(count, np.uint64)
    for row in range(count):
        value = np.uint64(width)
        for column in range(width):
            value = (value ^ np.uint64(bits[row, column])) * _MULTIPLIER
            value ^= value >> np.uint64(29)
        hashes[row] = value
    return hashes


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _equal_rows(rows, first, place):
    for row in range(len(rows)):
        other = first[place[row]]
        for column in range(rows.shape[1]):
            if rows[row, column] != rows[other, column]:
                return False
    return True


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz"})
def _find_widest_column(rows, mine):
    width = rows.shape[1]
    sums, squares = np.zeros(width), np.zeros(width)
    for row in mine:
        for column in range(width):
            value = np.float64(rows[row, column] - rows[mine[0], column])
            sums[column] += value
            squares[column] += value * value
    return np.argmax(squares - sums * sums / len(mine))
