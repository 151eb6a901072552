"""Pixels of a look's gap behind which nothing stands: other photos look through there, or the sky goes on."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Int64
from numpy import ndarray
from scipy import ndimage

from instdrive_core.edits.holes.behind.smooth_values import continue_smoothly

SPREAD = 1.5
"""Coarse pixels (standard deviation) over which votes of photos are gathered: one alone may look past a leaf."""
LEAST_VOTES = 1.0
"""Photos that must have looked at a pixel's place, in the mean around it, to tell of it."""
OPEN_SHARE = 0.5
"""Share of the votes, or of the sky as it spreads from around, above which nothing stands."""
LEAST_PIECE = 12
"""Pixels that would be closed beside open ones: a smaller piece would hang in the air."""


def find_open_pixels(
    gap: Bool[ndarray, "a b"],
    known: Bool[ndarray, "a b"],
    sky: Bool[ndarray, "a b"],
    past: Int64[ndarray, "a b"],
    met: Int64[ndarray, "a b"],
) -> Bool[ndarray, "a b"]:
    """Find pixels of the gap behind which nothing stands.

    Photos tell where they looked: `past` of them through what would stand there, `met` of them at something. Elsewhere
    the share of the sky is the smoothest (Laplace's equation) between what they tell and the `known` pixels around the
    gap, some of which show the `sky`.
    """
    through, at = (ndimage.gaussian_filter(np.where(gap, votes, 0).astype(np.float64), SPREAD) for votes in (past, met))
    inside = np.maximum(ndimage.gaussian_filter(gap.astype(np.float64), SPREAD), 1e-3)
    told = gap & ((through + at) / inside >= LEAST_VOTES)
    shares = np.where(told, through / np.maximum(through + at, 1e-6), sky)
    open_ = gap & (continue_smoothly(shares, known | told, gap & ~told) > OPEN_SHARE)
    return open_ | _find_crumbs(gap & ~open_, open_)


def _find_crumbs(closed: Bool[ndarray, "a b"], open_: Bool[ndarray, "a b"]) -> Bool[ndarray, "a b"]:
    """Small pieces of what would be closed that touch what stays open."""
    pieces = np.zeros(closed.shape, np.int32)
    ndimage.label(closed, output=pieces)
    crumbs = np.bincount(pieces.ravel()) < LEAST_PIECE
    touching = np.unique(pieces[np.asarray(ndimage.binary_dilation(open_), bool)])
    return closed & crumbs[pieces] & np.isin(pieces, touching)
