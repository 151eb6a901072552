"""The instance losses against hand-made cases and finite differences."""

import numpy as np
import pytest
import torch

from instdrive_core.training.instances import instance_losses as inst


def test_contrastive_matches_the_printed_sums():
    features = np.random.default_rng(0).normal(size=(30, 4))
    labels = np.repeat([5, 2, 9], [10, 4, 16])
    pull, push = inst.contrastive_loss(torch.from_numpy(features), inst.segments_from_labels(labels), 1.0)
    groups = [features[labels == label] for label in (2, 5, 9)]
    means = [group.mean(axis=0) for group in groups]
    expected_pull = np.mean([((g - m) ** 2).sum(axis=1).mean() for g, m in zip(groups, means, strict=True)])
    pairs = [1 / (((a - b) ** 2).sum() + 1) for i, a in enumerate(means) for j, b in enumerate(means) if i != j]
    assert float(pull) == pytest.approx(expected_pull, rel=1e-5)
    assert float(push) == pytest.approx(np.mean(pairs), rel=1e-5)


def test_one_mask_alone_is_pulled_but_not_pushed():
    pull, push = inst.contrastive_loss(torch.randn(5, 3), inst.segments_from_labels(np.ones(5, np.uint16)), 1.0)
    assert float(pull) > 0
    assert float(push) == 0


def test_losses_have_the_gradient_of_finite_differences():
    rng = np.random.default_rng(1)
    features = torch.from_numpy(rng.normal(size=(12, 3))).requires_grad_(True)
    segments = inst.segments_from_labels(np.repeat([1, 2, 3], 4))
    segments = inst.Segments(segments.segment, segments.sizes.double())
    assert torch.autograd.gradcheck(lambda f: sum(inst.contrastive_loss(f, segments, 0.5)), features)
    assert torch.autograd.gradcheck(lambda f: inst.pseudo_loss(f, segments), features)


def test_vote_takes_the_most_frequent_codeword_of_each_mask():
    codes = np.array([1, 1, 2, 3, 3, 3, 0, 2, 2])
    features = np.where((codes[:, None] >> np.arange(2)) & 1, 0.3, -0.3).astype(np.float32)
    winners = inst.vote_codewords(features, inst.segments_from_labels(np.repeat([7, 8], [3, 6])))
    assert winners.tolist() == [1, 3]


def test_vote_with_32_bits_keeps_masks_apart():
    features = np.full((4, 32), 1.0, np.float32)
    features[2:, 0] = -1
    winners = inst.vote_codewords(features, inst.segments_from_labels(np.array([1, 1, 2, 2])))
    assert winners.tolist() == [2**32 - 1, 2**32 - 2]


def test_pseudo_loss_is_zero_on_codewords_and_pulls_dissenters():
    agreed = torch.tensor([[1.0, -1.0], [1.0, -1.0], [1.0, -1.0]])
    segments = inst.segments_from_labels(np.array([4, 4, 4]))
    assert float(inst.pseudo_loss(agreed, segments)) == 0
    dissenting = agreed.clone()
    dissenting[2] = torch.tensor([-1.0, -1.0])
    assert float(inst.pseudo_loss(dissenting, segments)) == pytest.approx(4 / 3)


def test_stratified_pixels_give_each_mask_its_share():
    labels = np.zeros((40, 50), np.uint16)
    labels[:, :40], labels[:4, 45:] = 3, 9
    pixels = inst.sample_stratified_pixels(labels, 60, np.random.default_rng(0))
    chosen = labels.ravel()[pixels]
    assert (chosen == 3).sum() == 30
    assert (chosen == 9).sum() == 20
    assert len(np.unique(pixels)) == len(pixels)


def test_stratified_pixels_of_an_empty_map_are_none():
    assert len(inst.sample_stratified_pixels(np.zeros((4, 4), np.uint16), 60, np.random.default_rng(0))) == 0
