"""Events that a trainer reports to a progress bar, a log file, the editor."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from jaxtyping import UInt8
from numpy import ndarray

Stage = Literal["rgb", "instances"]


@dataclass(frozen=True)
class StepDone:
    """Progress, every `report_every` steps."""

    stage: Stage
    iteration: int
    """Steps done in this stage."""
    total: int
    loss: float
    psnr: float | None
    """PSNR of the last step's training image, dB; None in the instance stage."""
    gaussians: int
    seconds: float
    """Since training started, resumed parts included."""
    terms: dict[str, float] = field(default_factory=dict)
    """Each weighted loss term by name."""


@dataclass(frozen=True)
class StageStarted:
    """A stage begins, or goes on after a resume."""

    stage: Stage
    iteration: int
    total: int
    message: str = ""


@dataclass(frozen=True)
class CheckpointDue:
    """The trainer stands between two steps at a point worth keeping."""

    stage: Stage
    iteration: int
    ends_stage: bool = False
    """Nothing of the stage is left: this one is kept however soon it comes after another."""


@dataclass(frozen=True)
class DensifyDone:
    """Gaussians were added and removed."""

    iteration: int
    gaussians: int
    """How many there are now."""
    cloned: int
    split: int
    pruned: int


@dataclass(frozen=True)
class ViewDrawn:
    """A training photo as it was drawn in a step, for somebody to look at."""

    iteration: int
    key: str
    """Which photo, ``CAMERA/NN``."""
    drawn: UInt8[ndarray, "h w 3"]
    photo: UInt8[ndarray, "h w 3"]


Event = StepDone | StageStarted | CheckpointDue | DensifyDone | ViewDrawn
