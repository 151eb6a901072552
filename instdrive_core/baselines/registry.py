"""All baselines: methods that learn instances in another way than the trainer's own losses and votes.

A new baseline is its file, a record here, its name in `settings.config.Method` and `LEARNED_ELSEWHERE`, and its part of
docs/baselines.md. Generic tests run over the records.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from instdrive_core.baselines import gaussian_grouping, mask_graph, opengaussian
from instdrive_core.training.instances.instance_learner import InstanceLearner, LearnedInstances
from instdrive_core.training.settings.config import Method, Preset


@dataclass(frozen=True)
class Baseline:
    """One method, with its settings for long and for short runs."""

    method: Method
    """Its name for ``--method``."""
    title: str
    """Its name in tables and texts."""
    learn: Callable[..., LearnedInstances]
    """An `InstanceLearner` with one more keyword, `settings`."""
    published: Any
    """Settings with rates and lengths as published: a frozen dataclass."""
    short: Any
    """Settings tuned for short runs (docs/baselines.md), of the same class."""

    def choose_learner(self, preset: Preset) -> InstanceLearner:
        """Choose the learner of a preset: `paper` learns as published, the others by the short settings."""
        return partial(self.learn, settings=self.published if preset == "paper" else self.short)


BASELINES: tuple[Baseline, ...] = (
    Baseline(
        method="mask-graph",
        title="Mask graph",
        learn=mask_graph.learn_mask_graph,
        published=mask_graph.DEFAULT,
        short=mask_graph.DEFAULT,
    ),
    Baseline(
        method="gaussian-grouping",
        title="Gaussian Grouping",
        learn=gaussian_grouping.learn_gaussian_grouping,
        published=gaussian_grouping.PUBLISHED,
        short=gaussian_grouping.SHORT,
    ),
    Baseline(
        method="opengaussian",
        title="OpenGaussian",
        learn=opengaussian.learn_opengaussian,
        published=opengaussian.PUBLISHED,
        short=opengaussian.SHORT,
    ),
)


def find_learner(method: Method, preset: Preset = "quick") -> InstanceLearner | None:
    """Find the learner of a method; None for methods that the trainer knows itself."""
    for baseline in BASELINES:
        if baseline.method == method:
            return baseline.choose_learner(preset)
    return None
