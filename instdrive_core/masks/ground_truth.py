"""Ground truths, registered once: the object that each pixel shows, with IDs that hold in all frames and cameras."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, UInt32
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, Frame
from instdrive_core.errors import DataError
from instdrive_core.masks.annotated.labels import has_annotations
from instdrive_core.masks.annotated.truth import AnnotatedTruth
from instdrive_core.masks.exact import ExactLabels, has_exact_labels
from instdrive_core.masks.ground_truth_instance import GroundTruthInstance

__all__ = [
    "GROUND_TRUTHS",
    "NOT_KNOWN",
    "GroundTruth",
    "GroundTruthInstance",
    "GroundTruthKind",
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
        """Facts of each ID."""
        ...

    def load(self, frame: Frame) -> UInt32[ndarray, "h w"]:
        """Load IDs at the frame's size; 0 = unknown, to be ignored. Sky and ego vehicle are 0."""
        ...

    def load_sky(self, frame: Frame) -> Bool[ndarray, "h w"] | None:
        """Load the sky at the frame's size; None where it is not known."""
        ...


class UnknownLabels:
    """The labels of a clip that nobody annotated: every pixel is unknown, and only its photos can be compared with."""

    source = NOT_KNOWN

    def __init__(self) -> None:
        self.instances: dict[int, GroundTruthInstance] = {}

    def load(self, frame: Frame) -> UInt32[ndarray, "h w"]:
        """Give 0 everywhere."""
        return np.zeros((frame.view.camera.height, frame.view.camera.width), np.uint32)

    def load_sky(self, frame: Frame) -> None:
        """Give None: the sky is not known."""


@dataclass(frozen=True)
class GroundTruthKind:
    """A way to know which object each pixel of a clip shows."""

    name: str
    """Value of `GroundTruth.source` and of ``ground_truth`` in figures."""
    fits: Callable[[Clip], bool]
    """Whether a clip has what it is made from; cheap."""
    open: Callable[[Clip], GroundTruth]
    """Raises DataError where labels are damaged, or the clip lacks what they are made from."""


GROUND_TRUTHS = (
    GroundTruthKind("exact", lambda clip: has_exact_labels(clip.path), lambda clip: ExactLabels(clip.path)),
    GroundTruthKind("annotations", has_annotations, AnnotatedTruth),
    GroundTruthKind(NOT_KNOWN, lambda clip: True, lambda clip: UnknownLabels()),
)
"""The most exact first; the last fits every clip. Annotations use all sweeps, those of held-out time steps too."""


def find_ground_truth(clip: Clip) -> GroundTruth:
    """Open the most exact ground truth that a clip has; for photos alone, labels that leave every pixel unknown.

    Raises DataError where labels are damaged.
    """
    return next(kind for kind in GROUND_TRUTHS if kind.fits(clip)).open(clip)


def open_ground_truth(clip: Clip) -> GroundTruth:
    """Open the most exact ground truth that a clip has.

    Raises DataError where labels are damaged, or where nothing says which instance is where.
    """
    found = find_ground_truth(clip)
    if found.source == NOT_KNOWN:
        problem = "has no annotations: exact labels, or LiDAR with cuboids or semantic classes, are needed"
        raise DataError(clip.path, problem, "Measure only its images, or take another clip")
    return found
