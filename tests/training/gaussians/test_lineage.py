"""Which Gaussian comes from which: through refinements, and in checkpoints."""

import numpy as np
import pytest
import torch

from instdrive_core.training.gaussians.densify import GrowthStatistics, densify_and_prune
from instdrive_core.training.gaussians.lineage import Lineage
from instdrive_core.training.settings.config import DensifyConfig


def test_of_an_original_and_its_clone_the_original_stands_and_of_two_halves_the_first():
    lineage = Lineage.begin(np.array([5, 3, 9]))
    parents, fresh = np.array([1, 0, 1, 2, 2]), np.array([True, False, False, True, True])
    grown = lineage.rearrange(parents, fresh)
    assert grown.ancestors.tolist() == [3, 5, 3, 9, 9]
    assert grown.stands.tolist() == [False, True, True, True, False]
    again = grown.rearrange(np.array([0, 1, 2, 3, 4, 0]), np.array([False] * 5 + [True]))
    assert again.stands.tolist() == [False, True, True, True, False, False]
    kept = Lineage.from_state(again.state_tensors())
    assert np.array_equal(kept.ancestors, again.ancestors)
    assert np.array_equal(kept.stands, again.stands)


def test_a_row_that_stands_for_another_must_stay():
    with pytest.raises(ValueError, match="removed"):
        Lineage.begin(np.arange(2)).rearrange(np.array([1]), np.array([False]))


def test_refinements_prune_what_has_grown_but_no_row_that_stands():
    count, rng = 40, np.random.default_rng(0)
    parameters = {
        "means": torch.zeros(count, 3),
        "quats": torch.tensor([[1.0, 0, 0, 0]]).repeat(count, 1),
        "log_scales": torch.from_numpy(rng.normal(-1, 2, (count, 3)).astype(np.float32)),
        "opacity_logits": torch.full((count,), -9.0),
    }
    lineage, nodes = Lineage.begin(np.arange(count)), np.zeros(count, np.uint16)
    pruned = 0
    for step in range(3):
        statistics = GrowthStatistics(
            torch.from_numpy(rng.random(len(nodes)).astype(np.float32)), torch.ones(len(nodes))
        )
        config = DensifyConfig(max_gaussians=100, gradient_threshold=0.7)
        made = densify_and_prune(parameters, nodes, statistics, config, 1.0, rng, step > 0, spared=lineage.stands)
        parameters, nodes, lineage = made.parameters, made.nodes, lineage.rearrange(made.parents, made.fresh)
        pruned += made.pruned
        assert np.array_equal(np.sort(lineage.ancestors[lineage.stands]), np.arange(count))
    assert pruned > 0
