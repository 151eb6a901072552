"""Masks named after the objects that they show, and edges that become sharper by it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from tiny_training import new_trainer, tiny_config

from instdrive_core.masks.label_map_folder import MAX_LAYERS
from instdrive_core.training.instances.instance_learner import LearnedInstances
from instdrive_core.training.instances.mask_weights import look_at_grid
from instdrive_core.training.instances.named_masks import NamedMasks, name_masks
from instdrive_core.training.trainer import Trainer

TWO_MAPS = NamedMasks(
    objects=np.array([0, 1, 2]),
    maps=np.array([5 * MAX_LAYERS, 5 * MAX_LAYERS, 5 * MAX_LAYERS + 1, 6 * MAX_LAYERS], np.int32),
    labels=np.array([1, 2, 1, 1], np.int32),
    owners=np.array([0, 1, 2, 1]),
    fits=np.array([0.9, 0.4, 0.6, 0.9], np.float32),
    shadows=np.array([False, True, False]),
)
LAYERS = np.array([[1, 2, 2, 0, 7]], np.uint16), np.array([[1, 1, 0, 0, 0]], np.uint16)


def _learned(which: np.ndarray) -> LearnedInstances:
    return LearnedInstances(which.astype(np.uint32), np.zeros((len(which), 0), np.float32), 0)


def test_a_pixel_belongs_to_the_object_of_its_best_mask():
    """Masks that fit badly, labels that no mask was counted of, and pixels in no mask say nothing."""
    np.testing.assert_array_equal(TWO_MAPS.find_owners(5, LAYERS, 0.5), [[0, 2, -1, -1, -1]])
    np.testing.assert_array_equal(TWO_MAPS.find_owners(5, LAYERS, 0.3), [[0, 2, 1, -1, -1]])


def test_a_view_whose_masks_teach_nothing_gets_no_tags():
    rng, device = np.random.default_rng(0), torch.device("cpu")
    assert TWO_MAPS.draw_tags(4, LAYERS, 0.5, rng, device) is None
    assert TWO_MAPS.draw_tags(4, (), 0.5, rng, device) is None
    tags = TWO_MAPS.draw_tags(5, LAYERS, 0.5, rng, device)
    assert tags is not None
    assert tags.known.tolist() == [[True, True, False, False, False]]
    np.testing.assert_array_equal(tags.wanted[0, :2], tags.of_gaussians[[0, 2], :-1])
    assert tags.of_gaussians[1].tolist() == [0, 0, 0, 1]  # a shadow is whatever it falls on
    assert not tags.of_gaussians[[0, 2], -1].any()


def test_masks_are_named_after_what_they_show():
    trainer, which = new_trainer(tiny_config())
    named = name_masks(trainer.model, trainer.store, _learned(which), 0.5)
    views = [trainer.store.get(number) for number in range(len(trainer.store))]
    assert len(named.labels) == sum(len(np.unique(view.labels[view.labels > 0])) for view in views)
    assert named.fits.min() > 0.5  # the clusters stand apart
    for number, view in enumerate(views):
        owners = named.find_owners(number, view.layers, 0.5)
        for label in np.unique(view.labels[view.labels > 0]):
            assert len(np.unique(owners[view.labels == label])) == 1
    read = NamedMasks.from_tensors({name: tensor.clone() for name, tensor in named.to_tensors().items()})
    for name, array in vars(named).items():
        np.testing.assert_array_equal(getattr(read, name), array)


def test_checkpoints_from_before_shadows_know_none():
    tensors = TWO_MAPS.to_tensors()
    del tensors["shadows"]
    assert not NamedMasks.from_tensors(tensors).shadows.any()


def test_less_of_other_objects_shows_in_a_mask_once_its_edges_are_learned():
    """Measured as the share of blending weight in masks that belongs to other objects than the mask's."""
    before, without = _train_with(0.0)
    same, learned = _train_with(30.0)
    assert before == same > 0.02
    assert learned < 0.7 * without


def _train_with(weight: float) -> tuple[float, float]:
    """The share before and after a few steps from Gaussians that are far too large."""
    config = tiny_config()
    geometry = replace(config.geometry, edge_weight=weight, edge_fit=0.0, coarse_iterations=0)
    config = replace(config, geometry=geometry, densify=replace(config.densify, max_gaussians=0))
    trainer, which = new_trainer(config)
    trainer.model.parameters["log_scales"] += 1.2
    named = name_masks(trainer.model, trainer.store, _learned(which), 0.5)
    trainer.named_masks = named
    before = _measure_foreign_share(trainer, named)
    for iteration in range(40):
        trainer.iteration = min(iteration, config.geometry.iterations - 1)
        trainer.rgb_step()
    return before, _measure_foreign_share(trainer, named)


def _measure_foreign_share(trainer: Trainer, named: NamedMasks) -> float:
    foreign = total = 0.0
    for number in range(len(trainer.store)):
        view = trainer.store.get(number)
        rows, weights, pixels = look_at_grid(trainer.model, view, number, 0.0)
        owners = np.repeat(named.find_owners(number, view.layers, 0.0).ravel()[pixels], np.diff(weights.indptr))
        known = owners >= 0
        foreign += float(weights.weights[known & (named.objects[rows[weights.rows]] != owners)].sum())
        total += float(weights.weights[known].sum())
    return foreign / total
