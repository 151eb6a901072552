"""A step on cached blending weights against the same step through the rasterizer."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from tiny_training import new_trainer, tiny_config

from instdrive_core.maths.streams import Stream
from instdrive_core.training.gaussians.view_rendering import render_view
from instdrive_core.training.instances.feature_weights import blend_features, cache_view
from instdrive_core.training.instances.instance_losses import sample_stratified_pixels, segments_from_labels
from instdrive_core.training.losses.instance_terms import INSTANCE_TERMS, InstanceStep
from instdrive_core.training.losses.loss_term import compute_terms
from instdrive_core.training.settings.config import keep_geometry
from instdrive_core.training.trainer import Trainer


@pytest.fixture(scope="module")
def trainer() -> Trainer:
    config = keep_geometry(tiny_config())
    return new_trainer(replace(config, instances=replace(config.instances, voxel_weight=0.0)))[0]


def test_the_blended_features_and_their_gradient_are_those_of_the_rasterizer(trainer: Trainer):
    view, config = trainer.store.get(1), trainer.config.instances
    pixels = sample_stratified_pixels(view.labels, 400, np.random.default_rng(0))
    cached = cache_view(trainer.model, view, 0, pixels, config.min_alpha)
    drawn = render_view(trainer.model, trainer.backend, view.camera, view.time, True)
    chosen = pixels[drawn.alpha.detach().numpy().ravel()[pixels] >= config.min_alpha]
    assert len(chosen) > 0
    rendered = drawn.features.reshape(-1, config.feature_dim)[torch.from_numpy(chosen)]
    local = trainer.model.parameters["features"].detach()[cached.rows].requires_grad_(True)
    blended = blend_features(local, cached)
    np.testing.assert_allclose(blended.detach(), rendered.detach(), atol=1e-5)

    segments = segments_from_labels(view.labels.ravel()[chosen])
    for features in (blended, rendered):
        step = InstanceStep(
            trainer.config,
            trainer.config.instances.iterations,
            trainer.model,
            Stream.INSTANCE_VOXELS,
            features,
            segments,
        )
        torch.stack(list(compute_terms(INSTANCE_TERMS, step).values())).sum().backward()
    everywhere = torch.zeros(len(trainer.model), config.feature_dim)
    everywhere[drawn.rows] = drawn.gradients()["features"]
    largest = float(everywhere.abs().max())
    assert largest > 0
    found = torch.zeros_like(everywhere)
    found[cached.rows] = local.grad
    np.testing.assert_allclose(found, everywhere, atol=1e-4 * largest)


def test_a_step_without_the_voxel_loss_moves_the_seen_rows_alone(trainer: Trainer):
    before = trainer.model.parameters["features"].clone()
    trainer.instance_step()
    moved = torch.nonzero((trainer.model.parameters["features"] != before).any(dim=1))[:, 0]
    seen = {tuple(cached.rows.tolist()) for cached in trainer._cache}
    assert any(set(moved.tolist()) <= set(rows) for rows in seen)
    assert len(moved) > 10
    assert (trainer.optimizers.features.steps[moved] == 1).all()
