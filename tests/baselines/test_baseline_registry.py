"""Each baseline's record: settings of one kind, a learner that any training run can call."""

from __future__ import annotations

from dataclasses import is_dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from instdrive_core.baselines.registry import BASELINES, Baseline, find_learner
from instdrive_core.training.settings.config import LEARNED_ELSEWHERE, build_train_config

DOCS = Path(__file__).parents[2] / "docs" / "baselines.md"
FEW_STEPS = {"iterations": 3, "feature_iterations": 3, "codebook_iterations": 2}


def test_records_are_the_methods_that_the_trainer_leaves_to_others() -> None:
    methods = [baseline.method for baseline in BASELINES]
    assert len(set(methods)) == len(methods)
    assert set(methods) == set(LEARNED_ELSEWHERE)
    assert find_learner("instdrive") is None
    assert find_learner("paper") is None


@pytest.mark.parametrize("baseline", BASELINES, ids=lambda baseline: baseline.method)
class TestEachBaseline:
    def test_settings_are_of_one_class(self, baseline: Baseline) -> None:
        assert is_dataclass(baseline.published)
        assert type(baseline.published) is type(baseline.short)

    def test_presets_choose_the_settings(self, baseline: Baseline) -> None:
        assert find_learner(baseline.method, "paper").keywords == {"settings": baseline.published}
        assert find_learner(baseline.method, "quick").keywords == {"settings": baseline.short}

    def test_the_trainer_has_no_instance_stage_for_it(self, baseline: Baseline) -> None:
        assert build_train_config(baseline.method).instance_iterations == 0

    def test_it_is_documented(self, baseline: Baseline) -> None:
        assert baseline.method in DOCS.read_text()
        assert baseline.title.lower() in DOCS.read_text().lower()

    def test_it_learns_an_instance_for_each_gaussian_and_repeats_to_the_bit(self, baseline: Baseline, toy) -> None:
        few = {name: value for name, value in FEW_STEPS.items() if hasattr(baseline.short, name)}
        settings, notes = replace(baseline.short, **few), []
        first, second = (
            baseline.learn(toy.model, toy.store, toy.config, notes.append, settings=settings) for _ in range(2)
        )
        assert first.codewords.shape == (len(toy.model),)
        assert len(first.features) == len(toy.model)
        assert notes
        np.testing.assert_array_equal(first.codewords, second.codewords)
        np.testing.assert_array_equal(first.features, second.features)
