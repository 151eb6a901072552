import numpy as np
import pytest
from random_scene import random_gaussians

from instdrive_core.scene.gaussians import Gaussians, concatenate_gaussians, create_empty_gaussians


@pytest.fixture
def gaussians():
    return random_gaussians(np.random.default_rng(0), 20)


@pytest.mark.parametrize(
    ("name", "shape"),
    [
        ("means", (20, 2)),
        ("quats", (19, 4)),
        ("opacity_logits", (20, 1)),
        ("sh_rest", (20, 5, 3)),
        ("features", (3, 1)),
    ],
)
def test_wrong_shapes_are_named(gaussians, name, shape):
    # Set after construction: in tests beartype refuses such arguments before the class sees them.
    setattr(gaussians, name, np.zeros(shape, np.float32))
    with pytest.raises(ValueError, match=name):
        gaussians.__post_init__()


def test_arrays_are_kept_not_copied(gaussians):
    again = Gaussians(**gaussians.arrays())
    assert all(np.shares_memory(array, getattr(again, name)) for name, array in gaussians.arrays().items())


def test_physical_values(gaussians):
    np.testing.assert_allclose(gaussians.scales, np.exp(gaussians.log_scales))
    np.testing.assert_allclose(gaussians.opacities, 1 / (1 + np.exp(-gaussians.opacity_logits)), rtol=1e-5)
    assert gaussians.sh_degree == 3


def test_select_copy_and_concatenate(gaussians):
    parts = [gaussians.select(slice(0, 7)), gaussians.select(np.arange(7, 20))]
    joined = concatenate_gaussians(parts)
    for name, array in gaussians.arrays().items():
        np.testing.assert_array_equal(getattr(joined, name), array)
    copy = gaussians.copy()
    copy.means[0] = 9
    assert gaussians.means[0, 0] != 9
    assert len(create_empty_gaussians(8, 3)) == 0
    assert create_empty_gaussians(8, 3).sh_degree == 2
