"""The record of a loss term: its name, its weight, what it needs, and how it is computed."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from operator import attrgetter
from typing import Generic, Literal, Protocol, TypeVar, runtime_checkable

from torch import Tensor

from instdrive_core.training.settings.config import TrainConfig
from instdrive_core.training.settings.events import Stage

Need = Literal["photos", "LiDAR", "sky masks", "instance masks", "nothing"]
"""Data that a view must have for a term to be computed."""


@runtime_checkable
class Step(Protocol):
    """A training step, as far as every term needs it."""

    config: TrainConfig


S = TypeVar("S", bound=Step)


@dataclass(frozen=True)
class LossTerm(Generic[S]):
    """One term of the loss, computed from a step of type S."""

    name: str
    """Names the term in events, the log and the report."""
    meaning: str
    """Wish that the term expresses, in a few words; documentation shows it."""
    stage: Stage
    """Stage whose steps compute it; with the `joint` schedule, RGB steps compute the instance stage's terms, too."""
    needs: Need
    weight_field: str | None
    """Field of `TrainConfig` with the weight, as ``geometry.depth_weight``; 0 there switches the term off. None: the
    weight is 1."""
    compute: Callable[[S, float], Tensor]
    """The weighted term, a scalar, from the step and the weight."""
    is_due: Callable[[S], bool]
    """Whether the step has what the term needs, and the schedule wants it now."""

    def find_weight(self, config: TrainConfig) -> float:
        """Weight of the term in a configuration."""
        return 1.0 if self.weight_field is None else attrgetter(self.weight_field)(config)


def compute_terms(terms: Iterable[LossTerm[S]], step: S) -> dict[str, Tensor]:
    """Compute all terms that are switched on and due, by name, in the order given."""
    computed: dict[str, Tensor] = {}
    for term in terms:
        weight = term.find_weight(step.config)
        if weight and term.is_due(step):
            computed[term.name] = term.compute(step, weight)
    return computed
