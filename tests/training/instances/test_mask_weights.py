"""Weights of all views in one matrix: the same numbers as adding them one by one."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csr_array
from tiny_training import new_trainer, tiny_config

from instdrive_core.training.instances.mask_weights import MaskWeights, measure_mask_weights
from instdrive_core.training.instances.weight_spool import ViewWeights, WeightSpool
from instdrive_core.training.views.training_view import TrainingView
from instdrive_core.training.views.view_store import ViewStore


@pytest.mark.parametrize("in_memory", [1 << 20, 1])
def test_views_follow_one_another_in_every_row(in_memory):
    """Whether they waited in memory or in a file."""
    rng = np.random.default_rng(0)
    dense, parts, first = np.zeros((40, 30), np.float32), [], 0
    for masks in (7, 0, 12, 11):
        shown = (rng.random((40, masks)) < 0.3) * rng.random((40, masks), np.float32)
        rows, columns = np.nonzero(shown)
        used, counts = np.unique(rows, return_counts=True)
        values = shown[rows, columns].astype(np.float32)
        rows, counts, columns = (array.astype(np.int32) for array in (used, counts, columns + first))
        parts.append(ViewWeights(rows, counts, columns, values))
        dense[:, first : first + masks] = shown
        first += masks
    with WeightSpool(40, in_memory) as spool:
        for part in parts:
            spool.add(part)
        assert (getattr(spool._file, "_rolled", None) is True) == (in_memory == 1)
        matrix = spool.build_matrix(30)
    np.testing.assert_array_equal(matrix.toarray(), dense)
    assert matrix.has_sorted_indices
    assert matrix.indices.dtype == np.int32
    with WeightSpool(40) as spool:
        assert spool.build_matrix(30).nnz == 0


def test_what_is_silenced_has_no_weight_and_the_others_keep_theirs():
    weights = csr_array(np.array([[1, 0, 2], [0, 3, 0], [4, 0, 0]], np.float32))
    unmasked, shown = np.array([5, 6, 7], np.float32), np.array([8, 9, 11], np.float32)
    observed = MaskWeights(weights, np.array([0, 0, 1], np.int32), 1, unmasked, shown)
    silent = observed.silence(np.array([True, False, False]))
    assert silent.sum_shown().tolist() == [0, 9, 11]
    assert silent.sum_weights().tolist() == [0, 3, 4]
    assert silent.unmasked is not None
    assert silent.unmasked.tolist() == [0, 6, 7]
    assert observed.sum_weights().tolist() == [3, 3, 4]


def test_a_mask_says_little_of_what_a_photo_shows_in_no_mask():
    """Half of each photo loses its masks: who stands across the border speaks with the share that is still covered."""
    trainer, _ = new_trainer(tiny_config())
    whole = measure_mask_weights(trainer.model, trainer.store, 0.5)
    views = [_clear_right_half(trainer.store.get(number)) for number in range(len(trainer.store))]
    halved = measure_mask_weights(trainer.model, ViewStore.from_views(views), 0.5)
    assert halved.unmasked is not None
    np.testing.assert_allclose(halved.sum_shown(), whole.sum_shown(), rtol=1e-5)  # the photos are the same
    spoken = halved.sum_shown() - halved.unmasked
    said = halved.sum_weights()
    covered = spoken / np.maximum(halved.sum_shown(), 1e-9)
    crossing = (covered > 0.1) & (covered < 0.9)
    assert crossing.any()
    assert (said <= spoken * 1.001 + 1e-5).all()
    assert said[crossing].sum() < 0.9 * spoken[crossing].sum()


def _clear_right_half(view: TrainingView) -> TrainingView:
    assert view.labels is not None
    labels = view.labels.copy()
    labels[:, labels.shape[1] // 2 :] = 0
    return replace(view, labels=labels)
