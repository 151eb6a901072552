"""Gaussians of a moving object stay on it; shadows, what stands still and what is spared do not change."""

import numpy as np
import pytest
import torch

from instdrive_core.maths.spherical_harmonics import dc_from_color
from instdrive_core.training.gaussians.mover_reach import EXTENT, LEAST, MARGIN, keep_on_movers

BOXES = np.array([[4.6, 1.9, 1.5], [0.6, 0.6, 1.8]])
CAR, PERSON = 1, 2
TURNED = (np.cos(np.pi / 8), 0, 0, np.sin(np.pi / 8))


def one(mean, sizes, quat=(1, 0, 0, 0), color=0.5):
    """A single Gaussian, metres."""
    return {
        "means": torch.tensor([mean], dtype=torch.float32),
        "quats": torch.tensor([quat], dtype=torch.float32),
        "log_scales": torch.tensor([sizes], dtype=torch.float32).log(),
        "sh_dc": torch.from_numpy(dc_from_color(np.full((1, 3), color)).astype(np.float32)),
    }


def keep(values, node=PERSON, spared=None):
    """The mean and sizes that are left, metres."""
    keep_on_movers(values, np.array([node], np.uint16), BOXES, spared)
    return values["means"][0].numpy(), values["log_scales"][0].exp().numpy()


def test_a_patch_of_pavement_shrinks_to_the_person_that_learned_it():
    mean, sizes = keep(one((-0.2, -0.3, -0.8), (0.3, 1.0, 0.05)))
    np.testing.assert_allclose(mean, (-0.2, -0.3, -0.8), atol=1e-6)
    np.testing.assert_allclose(sizes, ((0.3 + MARGIN - 0.2) / EXTENT, (0.3 + MARGIN - 0.3) / EXTENT, 0.05), rtol=1e-5)


def test_axes_count_as_they_lie_in_the_box():
    _, sizes = keep(one((0, 0, 0), (2.0, 0.1, 0.1), TURNED))
    assert sizes[0] == pytest.approx((0.3 + MARGIN) / EXTENT / np.cos(np.pi / 4), rel=1e-5)
    assert sizes[1] == pytest.approx(0.1)


def test_what_left_the_box_comes_back_and_is_small():
    mean, sizes = keep(one((3.0, 0, 0), (0.5, 0.2, 0.2)))
    np.testing.assert_allclose(mean, (0.3 + MARGIN, 0, 0), rtol=1e-6)
    assert sizes[0] == pytest.approx(LEAST / EXTENT)


@pytest.mark.parametrize(
    ("values", "node"),
    [
        (one((0, 0.5, 0), (1.1, 0.3, 0.2)), CAR),
        (one((0.1, 0, 0.5), (0.05, 0.05, 0.2)), PERSON),
        (one((50, 0, 0), (30, 30, 1)), 0),
        (one((3.0, 1.5, -0.7), (1.0, 0.5, 0.01), color=0.0), CAR),  # a shadow
    ],
)
def test_what_fits_stands_still_or_is_a_shadow_keeps_its_bits(values, node):
    before = {name: value.clone() for name, value in values.items()}
    keep(values, node)
    assert all(torch.equal(values[name], before[name]) for name in values)


def test_spared_rows_stay():
    _, sizes = keep(one((0, 0, 0), (5.0, 5.0, 5.0)), spared=np.array([True]))
    assert sizes.tolist() == pytest.approx([5.0] * 3)


def test_gradients_may_be_asked_of_what_is_limited():
    values = {name: value.requires_grad_() for name, value in one((3, 0, 0), (1, 1, 1)).items()}
    keep_on_movers(values, np.array([PERSON], np.uint16), BOXES)
    assert values["means"][0, 0].item() == pytest.approx(0.6)
    assert all(value.requires_grad and value.is_leaf for value in values.values())
