"""Shape of what makes masks: each way of making them is a class of its own with these methods."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from jaxtyping import Bool, UInt32
from numpy import ndarray

from instdrive_core.datasets.clip import Frame


@runtime_checkable
class LabelSource(Protocol):
    """Makes the masks of one photo at a time; `sources.make_masks` writes them."""

    @property
    def source(self) -> str:
        """Its name on the command line and in the sidecar, e.g. ``exact``."""
        ...

    def load(self, frame: Frame) -> UInt32[ndarray, "h w"]:
        """Load a number per mask at the frame's size; 0 = none, also on the ego vehicle. Numbers need not agree between
        frames."""
        ...

    def load_sky(self, frame: Frame) -> Bool[ndarray, "h w"]:
        """Load the sky at the frame's size."""
        ...
