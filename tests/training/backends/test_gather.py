"""Gathered rows are those that torch would give."""

import numpy as np
import pytest
import torch

from instdrive_core.training.backends.row_gather import gather_rows


@pytest.mark.parametrize("shape", [(), (3,), (15, 3), (0, 3)])
@pytest.mark.parametrize("count", [0, 1, 5_000])
def test_rows_are_copied_in_their_order(shape, count):
    values = torch.randn(7_000, *shape, generator=torch.Generator().manual_seed(0)).requires_grad_(True)
    rows = torch.from_numpy(np.random.default_rng(0).integers(0, 7_000, count))
    result = gather_rows(values, rows)
    assert torch.equal(result, values.detach()[rows])
    assert not result.requires_grad
    assert result.is_contiguous()


def test_no_rows_of_nothing():
    assert gather_rows(torch.zeros(0, 3), torch.zeros(0, dtype=torch.int64)).shape == (0, 3)
