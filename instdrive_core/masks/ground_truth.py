"""What evaluation compares with: which object each pixel shows, with IDs that hold in all frames and cameras."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, UInt32
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, Frame
from instdrive_core.masks.annotated.labels import AnnotationLabels, has_annotations
from instdrive_core.masks.exact import ExactLabels, has_exact_labels
from instdrive_core.masks.ground_truth_instance import GroundTruthInstance

__all__ = [
    "NOT_KNOWN",
    "GroundTruth",
    "GroundTruthInstance",
    "UnknownLabels",
    "find_ground_truth",
    "open_ground_truth",
]

NOT_KNOWN = "none"
"""The source of labels that nobody gave."""


@runtime_checkable
class GroundTruth(Protocol):
    """Label maps with IDs that mean the same object in every frame."""

    @property
    def source(self) -> str:
        """``exact``, ``annotations``, or ``none`` where nothing is labelled."""
        ...

    @property
    def instances(self) -> dict[int, GroundTruthInstance]:
        """What each ID is."""
        ...

    def load(self, frame: Frame) -> UInt32[ndarray, "h w"]:
        """IDs at the frame's size; 0 = unknown, to be ignored. Sky and ego vehicle are 0."""
        ...

    def load_sky(self, frame: Frame) -> Bool[ndarray, "h w"] | None:
        """The sky at the frame's size; None where it is not known."""
        ...


def open_ground_truth(clip: Clip) -> GroundTruth:
    """Exact labels where the clip keeps them, else labels made from its annotations with all of its sweeps.

    Raises DataError where labels are damaged, or the clip has neither.
    """
    return ExactLabels(clip.path) if has_exact_labels(clip.path) else AnnotationLabels(clip, held_out=True)


def find_ground_truth(clip: Clip) -> GroundTruth:
    """As `open_ground_truth`; for a clip of photos alone, labels that leave every pixel unknown.

    Raises DataError where labels are damaged.
    """
    if has_exact_labels(clip.path) or has_annotations(clip):
        return open_ground_truth(clip)
    return UnknownLabels()


class UnknownLabels:
    """What is known of a clip without annotations: nothing, so that only its photos can be compared with."""

    source = NOT_KNOWN

    def __init__(self) -> None:
        self.instances: dict[int, GroundTruthInstance] = {}

    def load(self, frame: Frame) -> UInt32[ndarray, "h w"]:
        """All 0."""
        return np.zeros((frame.view.camera.height, frame.view.camera.width), np.uint32)

    def load_sky(self, frame: Frame) -> None:
        """Not known."""
