"""k-means within groups: each point is clustered among those of its own group only (Lloyd 1982; k-means++)."""

from __future__ import annotations

from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Float, Float32, Int64
from numpy import ndarray

_CHUNK = 1 << 12
"""Points that one thread takes at a time."""


def seed_centers(
    points: Float32[ndarray, "n d"], count: int, rng: np.random.Generator, sample: int = 20_000
) -> Float32[ndarray, "k d"]:
    """Seed centres by k-means++ (Arthur & Vassilvitskii 2007) on a sample; fewer where there are fewer points."""
    chosen = points[np.sort(rng.choice(len(points), min(sample, len(points)), replace=False))].astype(np.float64)
    centers = [chosen[rng.integers(len(chosen))]]
    squared = ((chosen - centers[0]) ** 2).sum(axis=1)
    while len(centers) < min(count, len(chosen)) and squared.sum() > 0:
        centers.append(chosen[rng.choice(len(chosen), p=squared / squared.sum())])
        squared = np.minimum(squared, ((chosen - centers[-1]) ** 2).sum(axis=1))
    return np.array(centers, np.float32)


def find_nearest_centers(
    points: Float32[ndarray, "n d"],
    centers: Float32[ndarray, "k d"],
    starts: Int64[ndarray, " g+1"],
    groups: Int64[ndarray, " n"],
) -> Int64[ndarray, " n"]:
    """Find the nearest (of equals the first) of the centres starts[g] … starts[g + 1] of each point's group g."""
    found = np.empty(len(points), np.int64)
    _assign(np.ascontiguousarray(points), np.ascontiguousarray(centers), starts, groups, found)
    return found


def move_centers(
    points: Float32[ndarray, "n d"], owners: Int64[ndarray, " n"], centers: Float32[ndarray, "k d"]
) -> Float32[ndarray, "k d"]:
    """Move each centre to the mean of its points; a centre without any stays."""
    counts = np.bincount(owners, minlength=len(centers))
    columns = [np.bincount(owners, weights=column, minlength=len(centers)) for column in points.T]
    means = np.stack(columns, axis=1) / np.maximum(counts, 1)[:, None]
    return np.where(counts[:, None] > 0, means, centers).astype(np.float32)


def run_lloyd(
    points: Float32[ndarray, "n d"],
    centers: Float32[ndarray, "k d"],
    starts: Int64[ndarray, " g+1"],
    groups: Int64[ndarray, " n"],
    rounds: int,
) -> tuple[Int64[ndarray, " n"], Float[ndarray, "k d"]]:
    """Run at most `rounds` rounds; returns the centre of each point, and the centres, means of their points."""
    owners = find_nearest_centers(points, centers, starts, groups)
    for _ in range(rounds):
        centers = move_centers(points, owners, centers)
        before, owners = owners, find_nearest_centers(points, centers, starts, groups)
        if np.array_equal(before, owners):
            break
    return owners, centers


@numba.njit(cache=True, parallel=True, error_model="numpy")
@no_type_check
def _assign(points, centers, starts, groups, found):
    dim = points.shape[1]
    for chunk in numba.prange((len(points) + _CHUNK - 1) // _CHUNK):
        for i in range(chunk * _CHUNK, min(len(points), (chunk + 1) * _CHUNK)):
            group = groups[i]
            best, winner = np.float32(np.inf), starts[group]
            for k in range(starts[group], starts[group + 1]):
                distance = np.float32(0)
                for c in range(dim):
                    difference = points[i, c] - centers[k, c]
                    distance += difference * difference
                if distance < best:
                    best, winner = distance, k
            found[i] = winner
