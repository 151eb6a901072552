"""What evaluation compares with: which object each pixel shows, with IDs that hold in all frames and cameras."""

from __future__ import annotations

from typing import Protocol

from jaxtyping import Bool, UInt32
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, Frame
from instdrive_core.masks.annotations import AnnotationLabels
from instdrive_core.masks.exact import ExactLabels, has_exact_labels
from instdrive_core.masks.ground_truth_instance import GroundTruthInstance

__all__ = ["GroundTruth", "GroundTruthInstance", "open_ground_truth"]


class GroundTruth(Protocol):
    """Label maps with IDs that mean the same object in every frame."""

    @property
    def source(self) -> str:
        """``exact`` or ``annotations``."""
        ...

    @property
    def instances(self) -> dict[int, GroundTruthInstance]:
        """What each ID is."""
        ...

    def load(self, frame: Frame) -> UInt32[ndarray, "h w"]:
        """IDs at the frame's size; 0 = unknown, to be ignored. Sky and ego vehicle are 0."""
        ...

    def sky(self, frame: Frame) -> Bool[ndarray, "h w"] | None:
        """The sky at the frame's size; None where it is not known."""
        ...


def open_ground_truth(clip: Clip) -> GroundTruth:
    """Exact labels where the clip keeps them, else labels made from its annotations with all of its sweeps.

    Raises DataError where labels are damaged, or the clip has neither.
    """
    return ExactLabels(clip.path) if has_exact_labels(clip.path) else AnnotationLabels(clip, held_out=True)
