"""Each loss term's record: where its weight is, that it can be switched off, and that it is documented."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tiny_training import new_trainer, tiny_config

from instdrive_core.training.instances.instance_learner import LearnedInstances
from instdrive_core.training.instances.named_masks import name_masks
from instdrive_core.training.losses.loss_term import LossTerm
from instdrive_core.training.losses.registry import LOSS_TERMS, format_loss_table
from instdrive_core.training.settings.config import TrainConfig, keep_geometry

WEIGHTED = [term for term in LOSS_TERMS if term.weight_field is not None]
METHOD = Path(__file__).parents[3] / "docs" / "method.md"


def _with_weight(config: TrainConfig, term: LossTerm, weight: float) -> TrainConfig:
    part, field = term.weight_field.split(".")
    return replace(config, **{part: replace(getattr(config, part), **{field: weight})})


def _terms_of_first_step(config: TrainConfig, stage: str) -> dict[str, float]:
    """The values of the first step in which everything is due; the terms are independent of each other."""
    config = replace(config, instances=replace(config.instances, pseudo_start=0.0))
    if stage == "instances":
        trainer, _ = new_trainer(keep_geometry(config))
        trainer.instance_step()
        return trainer.read_losses().terms
    trainer, which = new_trainer(config)
    trainer.model.shared["exposures"].data += 0.01
    learned = LearnedInstances(which.astype(np.uint32), np.zeros((len(which), 0), np.float32), 0)
    trainer.named_masks = name_masks(trainer.model, trainer.store, learned, config.instances.min_alpha)
    trainer.rgb_step()
    return trainer.read_losses().terms


def test_names_are_distinct() -> None:
    assert len({term.name for term in LOSS_TERMS}) == len(LOSS_TERMS)


@pytest.mark.parametrize("stage", ["rgb", "instances"])
def test_a_stage_computes_its_terms_and_no_others(stage: str) -> None:
    expected = [term.name for term in LOSS_TERMS if term.stage == stage]
    assert list(_terms_of_first_step(tiny_config(), stage)) == expected


def test_instance_terms_ride_along_with_the_joint_schedule() -> None:
    assert list(_terms_of_first_step(tiny_config("joint"), "rgb")) == [term.name for term in LOSS_TERMS]


@pytest.mark.parametrize("term", WEIGHTED, ids=lambda term: term.name)
def test_a_term_grows_with_its_weight_and_goes_with_it(term: LossTerm) -> None:
    config = tiny_config()
    weight = term.find_weight(config)
    assert weight > 0
    once = _terms_of_first_step(config, term.stage)
    twice = _terms_of_first_step(_with_weight(config, term, 2 * weight), term.stage)
    without = _terms_of_first_step(_with_weight(config, term, 0.0), term.stage)
    assert once[term.name] > 0
    np.testing.assert_allclose(twice[term.name], 2 * once[term.name], rtol=1e-5)
    assert term.name not in without
    shared = [other.name for other in LOSS_TERMS if other.weight_field == term.weight_field]
    assert without == {name: value for name, value in once.items() if name not in shared}


def test_documentation_has_the_table_of_terms() -> None:
    assert format_loss_table() in METHOD.read_text()
