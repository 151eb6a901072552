"""A finished scene holds nothing that nobody can see, and loses nothing else."""

import numpy as np
import torch

from instdrive_core.scene.lint import FAR_RADII
from instdrive_core.training.gaussians.last_prune import find_shown


def cloud(count=100):
    means = np.random.default_rng(0).normal(0, 10, (count, 3)).astype(np.float32)
    return {"means": torch.from_numpy(means), "opacity_logits": torch.zeros(count)}, np.zeros(count, np.uint16)


def test_what_is_too_faint_or_far_outside_goes():
    values, nodes = cloud()
    values["opacity_logits"][3] = -6.0
    values["opacity_logits"][4] = -5.0  # 0.0067
    values["means"][7] = torch.tensor([30.0 * FAR_RADII, 0, 0])
    assert np.flatnonzero(~find_shown(values, nodes)).tolist() == [3, 7]


def test_actors_may_be_anywhere_in_frames_of_their_own():
    values, nodes = cloud()
    values["means"][7] = torch.tensor([30.0 * FAR_RADII, 0, 0])
    nodes[7] = 1
    assert find_shown(values, nodes).all()


def test_spared_rows_and_one_at_least_stay():
    values, nodes = cloud()
    values["opacity_logits"][:] = -8.0
    values["opacity_logits"][5] = -7.0
    assert np.flatnonzero(find_shown(values, nodes)).tolist() == [5]
    assert np.flatnonzero(find_shown(values, nodes, np.arange(100) == 2)).tolist() == [2, 5]
    assert not len(find_shown({name: value[:0] for name, value in values.items()}, nodes[:0]))


def test_what_is_no_number_stays_to_be_told():
    values, nodes = cloud()
    values["opacity_logits"][1] = torch.nan
    values["means"][2] = torch.nan
    assert find_shown(values, nodes).all()
