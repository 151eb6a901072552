"""The instance losses on sampled pixels: contrastive and pseudo supervision (InstDrive, sec. 3.2 and 3.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int, Integer
from numpy import ndarray
from torch import Tensor

from instdrive_core.instances.codebook import decode_codewords, quantize_features


@dataclass(frozen=True)
class Segments:
    """Pixels grouped by mask; `segment` counts from 0."""

    segment: Int[Tensor, " p"]
    sizes: Float[Tensor, " m"]

    @property
    def count(self) -> int:
        """Number of groups."""
        return len(self.sizes)


def segments_from_labels(labels: Integer[ndarray, " p"]) -> Segments:
    """Group pixels by their masks, renumbered from 0. Labels are > 0."""
    _, segment, sizes = np.unique(labels, return_inverse=True, return_counts=True)
    return Segments(torch.from_numpy(segment.astype(np.int64)), torch.from_numpy(sizes.astype(np.float32)))


def average_segments(values: Float[Tensor, "p d"], segments: Segments) -> Float[Tensor, "m d"]:
    """Average the values over each segment: the prototypes."""
    sums = torch.zeros(segments.count, values.shape[1], dtype=values.dtype).index_add(0, segments.segment, values)
    return sums / segments.sizes[:, None]


def contrastive_loss(
    features: Float[Tensor, "p d"], segments: Segments, repulsion_offset: float
) -> tuple[Float[Tensor, ""], Float[Tensor, ""]]:
    """Pull and push: mean squared distance to the own prototype, mean 1 / (distance² + offset) between prototypes."""
    prototypes = average_segments(features, segments)
    squared = (features - prototypes[segments.segment]).square().sum(dim=1)
    weights = 1.0 / (segments.sizes[segments.segment] * segments.count)
    pull = (squared * weights).sum()
    if segments.count < 2:
        return pull, torch.zeros(())
    distances = (prototypes[:, None] - prototypes[None]).square().sum(dim=2)
    inverse = 1.0 / (distances + repulsion_offset)
    pairs = segments.count * (segments.count - 1)
    push = (inverse.sum() - inverse.diagonal().sum()) / pairs
    return pull, push


def vote_codewords(features: Float[ndarray, "p d"], segments: Segments) -> Integer[ndarray, " m"]:
    """Find the most frequent codeword inside each mask (ties: the smaller number)."""
    codes = quantize_features(features).astype(np.int64)
    keys = segments.segment.numpy() * (1 << 32) + codes
    pairs, counts = np.unique(keys, return_counts=True)
    owner = pairs >> 32
    order = np.lexsort((pairs, -counts, owner))
    first = np.unique(owner[order], return_index=True)[1]
    return pairs[order][first] & 0xFFFFFFFF


def pseudo_loss(features: Float[Tensor, "p d"], segments: Segments) -> Float[Tensor, ""]:
    """Mean squared distance to the codeword that wins the vote inside each pixel's mask; the target has no gradient."""
    values = features.detach().numpy()
    winners = vote_codewords(values, segments)
    targets = torch.from_numpy(decode_codewords(winners.astype(np.uint32), values.shape[1]))
    return (features - targets[segments.segment]).square().sum(dim=1).mean()


def sample_stratified_pixels(
    labels: Integer[ndarray, "h w"], budget: int, rng: np.random.Generator, min_per_mask: int = 8
) -> Integer[ndarray, " p"]:
    """Sample about `budget` flat pixel indices, as many from every mask (label > 0), without repetition, sorted."""
    flat = labels.ravel()
    inside = np.flatnonzero(flat)
    if not len(inside):
        return inside
    shuffled = rng.permutation(inside)
    order = shuffled[np.argsort(flat[shuffled], kind="stable")]
    _, starts, counts = np.unique(flat[order], return_index=True, return_counts=True)
    share = max(min_per_mask, budget // len(counts))
    rank = np.arange(len(order)) - np.repeat(starts, counts)
    return np.sort(order[rank < share])
