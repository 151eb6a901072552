"""No Gaussian outgrows the scene; all others keep their sizes bit by bit."""

import numpy as np
import pytest
import torch

from instdrive_core.training.gaussians.size_limit import limit_sizes


def parameters(count=200, seed=0):
    """Gaussians of 10 cm within 50 m."""
    rng = np.random.default_rng(seed)
    means = rng.uniform(-50, 50, (count, 3)).astype(np.float32)
    sizes = np.log(rng.uniform(0.05, 0.2, (count, 3))).astype(np.float32)
    return {"means": torch.from_numpy(means), "log_scales": torch.from_numpy(sizes)}


def test_what_outgrew_the_scene_shrinks_to_it():
    values, nodes = parameters(), np.zeros(200, np.uint16)
    values["log_scales"][3] = torch.tensor([np.log(900.0), -2.0, np.log(30.0)])
    before = values["log_scales"].clone()
    limit_sizes(values, nodes)
    assert values["log_scales"][3, 0].exp() == pytest.approx(80, abs=15)  # the far corners lie 87 m off
    before[3, 0] = values["log_scales"][3, 0]
    assert torch.equal(values["log_scales"], before)


def test_rows_on_actors_do_not_tell_how_large_the_scene_is():
    values, nodes = parameters(), np.zeros(200, np.uint16)
    nodes[100:] = 1
    values["means"][100:] *= 1000
    values["log_scales"][0] = np.log(900.0)
    limit_sizes(values, nodes)
    assert values["log_scales"][0].exp().tolist() == pytest.approx([80] * 3, abs=15)


def test_spared_rows_stay():
    values = parameters()
    values["log_scales"][:2] = np.log(900.0)
    limit_sizes(values, np.zeros(200, np.uint16), np.arange(200) == 1)
    assert values["log_scales"][1].exp().tolist() == pytest.approx([900] * 3)
    assert (values["log_scales"][0].exp() < 100).all()


def test_too_few_gaussians_set_no_limit():
    values = parameters(5)
    values["log_scales"][0] = np.log(900.0)
    limit_sizes(values, np.zeros(5, np.uint16))
    assert values["log_scales"][0].exp().tolist() == pytest.approx([900] * 3)
