"""Which methods learn instances in another way than the trainer's own losses."""

from __future__ import annotations

from functools import partial

from instdrive_core.baselines import gaussian_grouping, opengaussian
from instdrive_core.baselines.mask_graph import learn_mask_graph
from instdrive_core.training.instances.instance_learner import InstanceLearner
from instdrive_core.training.settings.config import Method, Preset


def find_learner(method: Method, preset: Preset = "quick") -> InstanceLearner | None:
    """The learner of a baseline; None for methods that the trainer knows itself.

    The preset `paper` takes rates and lengths as published, the others those tuned for short runs (docs/baselines.md).
    """
    published = preset == "paper"
    if method == "gaussian-grouping":
        settings = gaussian_grouping.PUBLISHED if published else gaussian_grouping.SHORT
        return partial(gaussian_grouping.learn_gaussian_grouping, settings=settings)
    if method == "opengaussian":
        return partial(
            opengaussian.learn_opengaussian, settings=opengaussian.PUBLISHED if published else opengaussian.SHORT
        )
    return learn_mask_graph if method == "mask-graph" else None
