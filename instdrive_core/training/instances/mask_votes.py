"""Hard instance IDs by weighted vote: masks are named after the objects they show best, Gaussians after their masks.

The two steps alternate until hardly anything changes. Errors of single masks are outvoted, and fragments that no mask
is best shown by give their Gaussians to the object around them.
"""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Bool, Float32, Int64
from numpy import ndarray
from scipy.sparse import csr_array

from instdrive_core.training.instances.mask_agreement import find_end_of_view, sum_by_group
from instdrive_core.training.instances.mask_weights import MaskWeights
from instdrive_core.training.settings.config import GraphConfig


def vote_groups(
    observed: MaskWeights,
    groups: Int64[ndarray, " n"],
    fixed: Bool[ndarray, " n"],
    config: GraphConfig,
    majority: float = 0.0,
) -> Int64[ndarray, " n"]:
    """Let masks and rows vote in turn; returns the group 0 … k - 1 of each row.

    Groups that lost all rows are gone.

    Args:
        observed: weights of the rows.
        groups: to start from, 0 … g - 1; rows of -1 take no part and stay -1.
        fixed: rows that keep their group (moving objects, whose tracks say what belongs to them).
        config: number of rounds, and how well a group must fit masks to stay.
        majority: share of its weight in masks that a row needs in those of another group to leave its own; with 0 it
            takes the one that has most.
    """
    voters = groups >= 0
    areas, stay = sum_mask_areas(observed, voters), fixed | ~voters
    groups = _alternate_votes(observed, groups, stay, areas, majority, config)
    fits = measure_group_fits(observed, groups, areas)
    kept = fits >= config.min_fit
    kept[groups[fixed & voters]] = True
    if kept.any() and not kept.all():
        names = np.where(kept, np.cumsum(kept) - 1, -1)
        groups = np.where(voters, names[groups], -1)
        groups = _alternate_votes(observed, groups, stay, areas, majority, config)
    return np.unique(groups, return_inverse=True)[1].astype(np.int64) - (1 if (groups < 0).any() else 0)


def sum_mask_areas(observed: MaskWeights, among: Bool[ndarray, " n"] | None = None) -> Float32[ndarray, " m"]:
    """Sum the masks' areas: the weight of everything in them, or of the rows among the given ones."""
    rows = np.ones(len(observed), np.float32) if among is None else among.astype(np.float32)
    return np.asarray(rows @ observed.weights, np.float32)


def measure_group_fits(
    observed: MaskWeights, groups: Int64[ndarray, " n"], areas: Float32[ndarray, " m"] | None = None
) -> Float32[ndarray, " g"]:
    """Measure how well each group fits masks: its best IoU in each photo, averaged with its weight in the photos.

    Fragments fit badly. `areas` are those of the masks; None = with everything in them.
    """
    of_groups, areas = _sum_groups(observed, groups, areas)
    fits = np.zeros(len(of_groups), np.float32)
    _fit(*_arrays(of_groups), areas, fits)
    return fits


def find_mask_owners(
    observed: MaskWeights, groups: Int64[ndarray, " n"], areas: Float32[ndarray, " m"] | None = None
) -> Int64[ndarray, " m"]:
    """Find the group that fits each mask best: the largest IoU in its photo (ties: the lower group), -1 = none.

    `areas` are those of the masks; None = with everything in them.

    IoU, not the share of the mask alone: a thin pole's mask holds more weight of the wall behind than of the pole.
    """
    of_groups, areas = _sum_groups(observed, groups, areas)
    owners, best = np.full(len(areas), -1, np.int64), np.zeros(len(areas), np.float32)
    _own(*_arrays(of_groups), areas, owners, best)
    return owners


def compute_vote_shares(observed: MaskWeights, groups: Int64[ndarray, " n"]) -> csr_array:
    """Compute the share (n, g) of each row's weight that lies in masks of each group; rows without any are empty."""
    owners = find_mask_owners(observed, groups)
    named = np.flatnonzero(owners >= 0)
    entries = (np.ones(len(named), np.float32), (named, owners[named]))
    votes = csr_array(observed.weights @ csr_array(entries, shape=(len(owners), int(groups.max(initial=-1)) + 1)))
    totals = np.asarray(votes.sum(axis=1)).ravel()
    return csr_array((votes.data / np.repeat(totals, np.diff(votes.indptr)), votes.indices, votes.indptr), votes.shape)


def _alternate_votes(
    observed: MaskWeights,
    groups: Int64[ndarray, " n"],
    stay: Bool[ndarray, " n"],
    areas: Float32[ndarray, " m"],
    majority: float,
    config: GraphConfig,
) -> Int64[ndarray, " n"]:
    matrix, voters = observed.weights, np.count_nonzero(~stay)
    for _ in range(config.vote_rounds):
        owners = find_mask_owners(observed, groups, areas)
        voted = groups.copy()
        _vote(matrix.indptr.astype(np.int64), matrix.indices, matrix.data, owners, stay, majority, voted)
        changed = np.count_nonzero(voted != groups)
        groups = voted
        if changed <= config.vote_tolerance * voters:
            break
    return groups


def _sum_groups(
    observed: MaskWeights, groups: Int64[ndarray, " n"], areas: Float32[ndarray, " m"] | None
) -> tuple[MaskWeights, Float32[ndarray, " m"]]:
    """Sum the weights of the groups, and the masks' areas where they are not known."""
    areas = sum_mask_areas(observed) if areas is None else areas
    return sum_by_group(observed, groups, int(groups.max(initial=-1)) + 1), areas


def _arrays(of_groups: MaskWeights) -> tuple[ndarray, ndarray, ndarray, ndarray]:
    matrix = of_groups.weights
    masks = matrix.indices.astype(np.int32)
    return matrix.indptr.astype(np.int64), masks, matrix.data.astype(np.float32), of_groups.view_of_mask


@numba.njit(cache=True, error_model="numpy")
def _own(starts, masks, values, view_of_mask, areas, owners, best):
    for group in range(len(starts) - 1):
        entry, end = starts[group], starts[group + 1]
        while entry < end:
            last = find_end_of_view(masks, view_of_mask, entry, end)
            total = values[entry:last].sum()
            for e in range(entry, last):
                iou = values[e] / (total + areas[masks[e]] - values[e])
                if iou > best[masks[e]]:
                    owners[masks[e]], best[masks[e]] = group, iou
            entry = last


@numba.njit(cache=True, error_model="numpy")
def _fit(starts, masks, values, view_of_mask, areas, fits):
    for group in range(len(starts) - 1):
        entry, end = starts[group], starts[group + 1]
        weight, fit = np.float32(0), np.float32(0)
        while entry < end:
            last, best = find_end_of_view(masks, view_of_mask, entry, end), np.float32(0)
            total = values[entry:last].sum()
            for e in range(entry, last):
                best = max(best, values[e] / (total + areas[masks[e]] - values[e]))
            weight += total
            fit += total * best
            entry = last
        fits[group] = fit / weight if weight > 0 else np.float32(0)


@numba.njit(parallel=True, cache=True, error_model="numpy")
def _vote(starts, masks, values, owners, fixed, majority, voted):
    """Each row takes the group whose masks hold most of its weight (ties: the one met first, in the earliest mask); one
    that has a group leaves it for a majority only."""
    for row in numba.prange(len(starts) - 1):
        if fixed[row]:
            continue
        count, total = starts[row + 1] - starts[row], values[starts[row] : starts[row + 1]].sum()
        candidates, ballots, found = np.empty(count, np.int64), np.zeros(count, np.float32), 0
        for entry in range(starts[row], starts[row + 1]):
            owner = owners[masks[entry]]
            if owner < 0:
                continue
            place = 0
            while place < found and candidates[place] != owner:
                place += 1
            if place == found:
                candidates[place] = owner
                found += 1
            ballots[place] += values[entry]
        if found:
            best = np.argmax(ballots[:found])
            if voted[row] < 0 or ballots[best] >= majority * total:
                voted[row] = candidates[best]
