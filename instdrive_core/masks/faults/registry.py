"""The published sets of faults by name; a name never changes its meaning."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from jaxtyping import UInt32
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, Frame
from instdrive_core.errors import OptionError
from instdrive_core.masks.faults.frame_faults import MaskFaults, add_faults
from instdrive_core.masks.faults.repeated_faults import (
    MEDIUM,
    MILD,
    STRONG,
    RepeatedFaults,
    make_segmenter_masks,
)
from instdrive_core.masks.label_map_folder import FrameMasks, shuffle_labels
from instdrive_core.masks.label_source import LabelSource

FaultModel = Literal["sam-v1", "sam-v2", "sam-v2-mild", "sam-v2-strong"]


@runtime_checkable
class FaultySource(Protocol):
    """Makes a photo's masks with faults."""

    def load(self, frame: Frame) -> FrameMasks:
        """Masks at the frame's size, labels in random order."""
        ...


@dataclass(frozen=True)
class FaultSet:
    """A set of faults by name."""

    name: str
    summary: str
    """What goes wrong, for the command line's help."""
    needs_exact: bool
    """Whether only a synthetic clip's own labels can be damaged so."""
    open: Callable[[Clip, LabelSource, int], FaultySource]
    """Raises DataError where the clip lacks what the faults need."""


@dataclass(frozen=True)
class FrameFaultSource:
    """Faults that each photo draws for itself (``sam-v1``)."""

    labels: LabelSource
    faults: MaskFaults
    seed: int

    def load(self, frame: Frame) -> FrameMasks:
        """Damage the exact labels of a photo."""
        sky = self.labels.load_sky(frame)
        closed = sky if frame.valid is None else sky | ~frame.valid
        found = add_faults(self.labels.load(frame), closed, self.faults, frame.key, self.seed)
        return FrameMasks(shuffle_labels(found, frame.key, self.seed), sky)


class RepeatedFaultSource:
    """Faults that repeat over the photos of a synthetic clip (``sam-v2``)."""

    def __init__(self, clip: Clip, faults: RepeatedFaults, seed: int) -> None:
        """Raises DataError where the clip keeps no config of its street."""
        from instdrive_core.datasets.synthetic.units import StreetUnits

        self.street, self.faults, self.seed = StreetUnits(clip.path), faults, seed
        self.cameras = {name: number for number, name in enumerate(sorted(clip.camera_names))}

    def load(self, frame: Frame) -> FrameMasks:
        """Ask the street what the photo shows, and make the masks of a segmenter."""
        view = frame.view
        units = self.street.look(view.name, view.index, view.camera.width, view.camera.height)
        layers, sky = make_segmenter_masks(
            units,
            self.street.families,
            self.street.is_thing,
            self.faults,
            self.cameras[view.name],
            view.index,
            frame.key,
            self.seed,
        )
        small, large = (self._shuffle(layer, frame, number) for number, layer in enumerate(layers))
        return FrameMasks(small, sky, (large,))

    def _shuffle(self, labels: UInt32[ndarray, "h w"], frame: Frame, layer: int) -> ndarray:
        kept = labels if frame.valid is None else np.where(frame.valid, labels, np.uint32(0))
        return shuffle_labels(kept, f"{frame.key}/{layer}" if layer else frame.key, self.seed)


def _open_frame_faults(clip: Clip, labels: LabelSource, seed: int) -> FaultySource:
    return FrameFaultSource(labels, MaskFaults(), seed)


FAULT_SETS = (
    FaultSet(
        "sam-v1",
        "splits 25 % of the objects, merges 10 % of touching pairs, misses 10 % of the objects, ragged borders; each "
        "photo by itself",
        False,
        _open_frame_faults,
    ),
    *(
        FaultSet(
            name,
            f"what segmenters do, repeated over photos: parts, unmasked regions, shadows, merged pairs ({strength})",
            True,
            lambda clip, labels, seed, faults=faults: RepeatedFaultSource(clip, faults, seed),
        )
        for name, strength, faults in (
            ("sam-v2", "medium, the standard", MEDIUM),
            ("sam-v2-mild", "mild", MILD),
            ("sam-v2-strong", "strong", STRONG),
        )
    ),
)
"""In the order in which help and errors list them."""


def find_fault_set(name: str) -> FaultSet:
    """Look a set of faults up. Raises OptionError where there is none of this name."""
    for known in FAULT_SETS:
        if known.name == name:
            return known
    raise OptionError(f"There are no faults '{name}'; choose {', '.join(known.name for known in FAULT_SETS)}")
